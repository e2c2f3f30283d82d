"""Every key and every value knows where it was written."""

from __future__ import annotations

import pathlib

import pytest

from r2bspec.diagnostics import Path, Span
from r2bspec.language.document import Source, inner_span
from r2bspec.language.located_tree import ScalarNode, TreeNode, lookup, span_at, to_plain
from r2bspec.language.yaml_document import compose

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


def test_a_block_collection_ends_with_its_last_value() -> None:
    span = span_at(tree_of(TEXT), ("nodes", "first"))
    assert (span.line, span.column, span.end_line, span.end_column) == (5, 5, 6, 15)


def test_a_key_without_value_has_a_place() -> None:
    assert span_at(tree_of(TEXT), ("empty",)).line == 14


def test_plain_data() -> None:
    assert to_plain(tree_of(TEXT)) == {
        "name": "relay",
        "x-base": {"a": 1, "b": "two"},
        "nodes": {"first": {"a": 1, "b": "three"}, "second": {"a": 1, "b": "two"}},
        "list": ["10 Hz", ["x", "y"]],
        "text": "one\ntwo\n",
        "empty": None,
    }


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


def test_the_second_of_two_equal_pieces() -> None:
    text = "a: x x"
    span = inner_span(Source("f", text), Span("f", 1, 4, 1, 7), "x x", 2, 1)
    assert span.column == 6


def test_a_piece_on_a_later_line() -> None:
    text = "a: |\n  one\n  two\n"
    node = lookup(tree_of(text), ("a",))
    assert isinstance(node, ScalarNode)
    span = inner_span(Source("f", text), node.span, node.text, node.text.index("two"), 3)
    assert (span.line, span.column, span.end_column) == (3, 3, 6)


def test_what_cannot_be_found_is_the_whole_value() -> None:
    whole = Span("f", 1, 4, 1, 12)
    assert inner_span(Source("f", 'a: "\\x41b"'), whole, "Ab", 0, 1) == whole
