"""What an unquoted word means."""

from __future__ import annotations

import pytest

from r2bspec.language.yaml_document import ScalarError, resolve


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *((word, None) for word in ("", "~", "null", "Null", "NULL")),
        *((word, True) for word in ("true", "True", "TRUE")),
        *((word, False) for word in ("false", "False", "FALSE")),
        ("0", 0),
        ("-7", -7),
        ("+7", 7),
        ("0x1F", 31),
        ("0o17", 15),
        ("9223372036854775807", 2**63 - 1),
        ("-9223372036854775808", -(2**63)),
        ("1.5", 1.5),
        (".5", 0.5),
        ("1.", 1.0),
        ("1e3", 1000.0),
        ("-1.5E-3", -0.0015),
    ],
)
def test_words_with_a_meaning(text: str, value: object) -> None:
    assert resolve(text) == value
    assert type(resolve(text)) is type(value)


@pytest.mark.parametrize(
    "text",
    [
        *("on", "off", "yes", "no", "y", "n", "tRue", "nULL"),
        *("010", "-010", "00", "1_000", "12:30", "2024-01-01", "0b1", "0x", "0o8", "08.5"),
        *(".", "-", "+", "e3", "1e", "1.2.3", "--1", "infinity", "nan", "30 Hz", "1,5", "٣"),
    ],
)
def test_words_that_are_text(text: str) -> None:
    assert resolve(text) == text


@pytest.mark.parametrize(
    "text", ["9223372036854775808", "-9223372036854775809", "9" * 100_000, "0x" + "f" * 17]
)
def test_whole_numbers_have_64_bits(text: str) -> None:
    with pytest.raises(ScalarError, match="64 bits"):
        resolve(text)


@pytest.mark.parametrize("text", [".inf", "-.INF", "+.Inf", ".nan", ".NaN", "1e999"])
def test_numbers_are_finite(text: str) -> None:
    with pytest.raises(ScalarError, match="finite"):
        resolve(text)
