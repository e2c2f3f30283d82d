"""What is read from a document: words, places, and the limits of what hurts."""

from __future__ import annotations

import pathlib

import pytest

from r2bspec.diagnostics import Path, Span
from r2bspec.language.document import Source, inner_span
from r2bspec.language.load_spec import load_spec
from r2bspec.language.located_tree import ScalarNode, TreeNode, lookup, span_at
from r2bspec.language.yaml_document import ScalarError, compose, resolve
from r2bspec.safe_io.limits import MAX_DOCUMENT_BYTES

# What an unquoted word means.


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


# Every key and every value knows where it was written.


TEXT = pathlib.Path(__file__).with_name("positions.yaml").read_text(encoding="utf-8")


def tree_of(text: str) -> TreeNode:
    composed = compose(Source("f.yaml", text))
    assert composed.tree is not None, composed.diagnostics
    assert composed.diagnostics == ()
    return composed.tree


def shown(span: Span) -> str:
    """The characters of a span within one line."""
    line = TEXT.splitlines()[span.line - 1]
    return f"{span.line}:{span.column} {line[span.column - 1 : span.end_column - 1]}"


@pytest.mark.parametrize(
    ("path", "key", "place"),
    [
        (("name",), False, "1:7 relay"),
        (("name",), True, "1:1 name"),
        (("nodes", "first", "a"), False, "2:19 1"),  # merged: where it was written
        (("nodes", "first", "b"), False, "6:8 'three'"),
        (("nodes", "second", "b"), False, '2:25 "two"'),
        (("nodes", "second"), True, "7:3 second"),
        (("list", 0), False, "9:5 10 Hz"),
        (("list", 1, 1), False, "10:9 y"),
        (("list", 1), True, "10:5 [x, y]"),
        (("nodes", "third"), False, "3:1 nodes"),  # missing: the key of what is there
        (("nodes", "first", "c", "d"), True, "4:3 first"),
        (("list", 7), False, "8:1 list"),
        (("name", "deeper"), False, "1:1 name"),
        (("nowhere",), False, "1:1 name"),
    ],
)
def test_where_things_stand(path: Path, key: bool, place: str) -> None:
    assert shown(span_at(tree_of(TEXT), path, key=key)) == place


@pytest.mark.parametrize(
    ("written", "piece", "columns"),
    [
        ("a: latency.p99 < 5 ms", "5 ms", (18, 22)),
        ("a: 'latency < 5 ms'", "5 ms", (15, 19)),
        ('a: "x < 5 ms"', "5 ms", (9, 13)),
        ("a: 'it''s < 5 ms'", "5 ms", (13, 17)),
        ('a: "\\u0061b < 5 ms"', "5 ms", (15, 19)),
        ("a: $(var x) $(var x)", "$(var x)", (4, 12)),
    ],
)
def test_columns_inside_a_value(written: str, piece: str, columns: tuple[int, int]) -> None:
    source = Source("f.yaml", written)
    node = lookup(tree_of(written), ("a",))
    assert isinstance(node, ScalarNode)
    span = inner_span(source, node.span, node.text, node.text.index(piece), len(piece))
    assert (span.column, span.end_column) == columns


# Documents made to hurt: each is answered, in bounded time; for memory, see tests/fuzz.


@pytest.mark.parametrize(
    "content", [b"a" * (MAX_DOCUMENT_BYTES + 1), "a" * (MAX_DOCUMENT_BYTES + 1)]
)
def test_a_large_document_is_refused(content: str | bytes) -> None:
    assert [found.code for found in load_spec(content).diagnostics] == ["R2B002"]


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    "content",
    [
        "".join(f"key{i}: 1\n" for i in range(20_000)),
        "key: 1\n" * 20_000,
        "benchmark: {rates: [" + "1," * 20_000 + "]}",
        "variables: {x: 1}\ntitle: '" + "$(var y)" * 20_000 + "'",
        "title: '" + "$(var " * 20_000 + "'",
    ],
    ids=["unknown", "twice", "units", "unset", "unclosed"],
)
def test_many_mistakes_are_cut_off(content: str) -> None:
    found = load_spec(content).diagnostics
    assert len(found) in (1000, 1001, 1002)


def test_a_file_that_cannot_be_read(tmp_path: pathlib.Path) -> None:
    for path in (tmp_path, tmp_path / "missing.r2b.yaml"):
        (found,) = load_spec(path).diagnostics
        assert found.code == "R2B001"
