"""`--set a.b.c=v` and `--var x=v`: values given on the command line.

Each option is a source of its own: a finding in it shows the option with a caret. A value that
begins with a bracket, a brace or a quote is read as YAML, any other as an unquoted scalar.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import msgspec
from msgspec.structs import replace

from r2bspec.diagnostics import Path, Span, did_you_mean, format_path
from r2bspec.diagnostics.quote import quote
from r2bspec.language.declaration import rule_at
from r2bspec.language.document import Document, Source, read_text
from r2bspec.language.extends import KEY as EXTENDS
from r2bspec.language.located_tree import (
    Entry,
    ListNode,
    MapNode,
    ScalarNode,
    TreeNode,
    UnknownNode,
    child,
    lookup,
    replace_at,
)
from r2bspec.language.selected_spec import Variables
from r2bspec.language.variables import is_declared_text, with_variable
from r2bspec.language.yaml_document import compose, parse_unquoted

_PART = re.compile(r"\[(\d{1,9})\]|\['([^']*)'\]|(?:^|\.)([^.\[\]'=]+)")


class _Option(msgspec.Struct, frozen=True):
    """The text of an option, its path, and the offsets of each part and of the value."""

    source: Source
    path: Path
    offsets: tuple[int, ...]
    value_offset: int

    def span(self, start: int, end: int) -> Span:
        return Span(self.source.file, 1, start + 1, 1, max(end, start + 1) + 1)


def apply_overrides(document: Document, sets: Sequence[str], variables: Variables) -> None:
    """Apply `sets`, each ``path=value``, in their order, then `variables`."""
    for text in sets:
        _apply_set(document, text)
    for name, given in variables.items():
        shown = str(given).lower() if isinstance(given, bool) else str(given)
        _apply_variable(document, name, shown)


def parse_path(text: str) -> Path:
    """The path in a text such as ``data_loader.topics['/a']``; empty if the text is not a path."""
    return _parse(f"{text}=").path


def _apply_set(document: Document, text: str) -> None:
    option = _parse(text)
    document.sources[option.source.file] = option.source
    if not option.path:
        document.problems.error(
            "R2B127",
            f"expected PATH=VALUE, found {quote(text)}",
            option.span(0, len(text)),
            "for example: --set benchmark.iterations=3",
        )
        return
    node: TreeNode | None = document.tree
    for depth, part in enumerate(option.path):
        below = child(node, part)
        if below is None and not _can_add(node, option.path[: depth + 1]):
            start = option.offsets[depth]
            wrong = format_path(option.path[: depth + 1])
            span = option.span(start, start + len(str(part)))
            message = f"the document has no '{wrong}' to replace"
            help_text = _path_suggestion(node, option.path[: depth + 1])
            document.problems.error("R2B127", message, span, help_text)
            return
        node = below
    value = _value(document, option)
    document.tree = _with_value(document.tree, option, 0, value)


def _can_add(node: TreeNode | None, path: Path) -> bool:
    """Whether a value that the document lacks can be set: a key of the language.

    A name that the user chooses, such as that of a node, is added only where its value has no keys
    of its own, as a parameter has none: a misspelt node must not become a second one.

    Args:
        node: the parent; None if the document lacks it, too.
        path: of the value.
    """
    if not (node is None or isinstance(node, MapNode) or _is_empty(node)):
        return False
    key = path[-1]
    if not isinstance(key, str) or key == EXTENDS:
        return False
    parent = rule_at(path[:-1])
    if parent is None or "object" not in parent.kinds:
        return False
    return key in (parent.keys or ()) or (parent.values is not None and parent.values.keys is None)


def _is_empty(node: TreeNode) -> bool:
    """Whether it is a key without a value, as in ``benchmark:``."""
    return isinstance(node, ScalarNode) and node.value is None


def _with_value(root: TreeNode | None, option: _Option, depth: int, value: TreeNode) -> TreeNode:
    """The tree with the value at the option's path, and the maps above it that were missing."""
    if depth == len(option.path):
        return value
    part = option.path[depth]
    below = child(root, part)
    changed = _with_value(below, option, depth + 1, value)
    if root is not None and below is not None:
        return replace_at(root, (part,), changed)
    span = option.span(option.offsets[depth], option.offsets[depth] + len(str(part)))
    entries = root.entries if isinstance(root, MapNode) else {}
    place = root.span if isinstance(root, MapNode) else span
    return MapNode({**entries, str(part): Entry(span, changed)}, place)


def _apply_variable(document: Document, name: str, text: str) -> None:
    source = Source(f"--var {name}", f"{name}={text}")
    option = _Option(source, ("variables", name), (0, 0), len(name) + 1)
    document.sources[source.file] = source
    root = document.tree
    if root is None:
        return
    if lookup(root, ("matrix", "axes", name)) is not None:
        document.problems.error(
            "R2B128",
            f"{quote(name)} is an axis of the matrix: its value depends on the case",
            option.span(0, len(name)),
            "select a case with --case, or replace the axis: "
            + quote(f"--set matrix.axes.{name}=[{text}]"),
        )
        return
    declared = child(root, "variables")
    known = declared.entries if isinstance(declared, MapNode) else {}
    if name not in known:
        close = did_you_mean(name, known)
        listed = (
            "declared variables: " + ", ".join(sorted(known)[:10])
            if known
            else "the document declares no variables"
        )
        document.problems.error(
            "R2B128",
            f"unknown variable {quote(name)}",
            option.span(0, len(name)),
            f"did you mean '{close}'? {listed}" if close else listed,
        )
        return
    value = _value(document, option)
    if is_declared_text(known[name].value) and isinstance(value, ScalarNode):
        value = ScalarNode(text, text, value.span, '"')
    document.tree = with_variable(root, name, value)


def _parse(text: str) -> _Option:
    path: list[str | int] = []
    offsets: list[int] = []
    at = 0
    while at < len(text) and text[at] != "=":
        match = _PART.match(text, at)
        if match is None:
            return _Option(Source("--set", text), (), (), 0)
        index, quoted, name = match.groups()
        path.append(int(index) if index is not None else quoted if quoted is not None else name)
        offsets.append(match.start(match.lastindex or 0))
        at = match.end()
    if at >= len(text):
        return _Option(Source("--set", text), (), (), 0)
    source = Source(f"--set {text[:at]}", text)
    return _Option(source, tuple(path), tuple(offsets), at + 1)


def _value(document: Document, option: _Option) -> TreeNode:
    text = option.source.text[option.value_offset :]
    span = option.span(option.value_offset, len(option.source.text))
    if text[:1] not in ("[", "{", "'", '"'):
        read = read_text(text, option.source.file)
        if not read.usable:
            document.problems.diagnostics += [
                replace(found, span=span) for found in read.diagnostics
            ]
            return UnknownNode(span)
        return ScalarNode(parse_unquoted(text), text, span)
    # Spaces in place of the path keep the columns.
    padded = read_text(" " * option.value_offset + text, option.source.file)
    if not padded.usable:
        document.problems.diagnostics += padded.diagnostics
        return UnknownNode(span)
    composed = compose(padded.source)
    document.problems.diagnostics += composed.diagnostics
    return composed.tree or UnknownNode(span)


def _path_suggestion(node: TreeNode | None, path: Path) -> str:
    """What to write instead of the last part of a path."""
    if isinstance(node, ListNode):
        return f"the list has {len(node.items)} items, the first is [0]"
    parent = rule_at(path[:-1])
    written = list(node.entries) if isinstance(node, MapNode) else []
    of_language = parent.keys or () if parent is not None and (node is None or written) else ()
    keys = list(dict.fromkeys([*written, *of_language]))
    if keys:
        close = did_you_mean(str(path[-1]), keys)
        known = "known keys: " + ", ".join(keys[:12])
        return f"did you mean '{close}'? {known}" if close else known
    return "--set can only replace values that the document has, or set keys of the language"
