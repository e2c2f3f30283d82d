"""Small helpers of diagnostics."""

from __future__ import annotations

import pytest

from r2bspec.diagnostics import did_you_mean, format_path
from r2bspec.diagnostics.quote import clip, quote


@pytest.mark.parametrize(
    ("wrong", "known", "meant"),
    [
        ("durration", ["duration", "rates"], "duration"),
        ("RATES", ["duration", "rates"], "rates"),
        ("xyz", ["duration", "rates"], ""),
        ("a", [], ""),
        ("d" * 1000, ["d" * 999], ""),
    ],
)
def test_did_you_mean(wrong: str, known: list[str], meant: str) -> None:
    assert did_you_mean(wrong, known) == meant


def test_paths_read_as_they_are_addressed() -> None:
    path = ("data_loader", "topics", "/a/b", 0, "my-key")
    assert format_path(path) == "data_loader.topics['/a/b'][0].my-key"


def test_quoting_is_short_and_harmless() -> None:
    assert quote("x") == "'x'"
    assert len(quote("x" * 10_000)) < 70
    assert clip("a\nb\tc\x1b") == "a⏎b c\ufffd"
