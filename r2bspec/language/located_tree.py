"""The located tree: a YAML document with the place of every key and value.

The tree is immutable. Anchored values are shared, not copied, and keep the place where they are
written; the composer limits the size of the tree with all aliases expanded.

Its types are msgspec's, not dataclasses: a document has hundreds of nodes, and making a frozen
dataclass takes twenty times as long. Trees have no cycles, so the collector need not know them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from r2bspec.diagnostics.diagnostic import Path, Related, Span

ScalarValue = bool | int | float | str | None


class ScalarNode(msgspec.Struct, frozen=True, gc=False):
    """A scalar value.

    Attributes:
        value: the value of the text.
        text: the characters, without quotes and escapes.
        span: its place, quotes included.
        style: ``""`` for plain, else the quote or block indicator: ``'``, ``"``, ``|`` or ``>``.
        origin: the place of the variable that the value comes from, if it does.
    """

    value: ScalarValue
    text: str
    span: Span
    style: str = ""
    origin: Related | None = None


class ListNode(msgspec.Struct, frozen=True, gc=False):
    """A sequence of values."""

    items: tuple[TreeNode, ...]
    span: Span


class UnknownNode(msgspec.Struct, frozen=True, gc=False):
    """A value that could not be determined; the reason has been reported."""

    span: Span


class Entry(msgspec.Struct, frozen=True, gc=False):
    """A key with its value. `key_resolved` is False if substitution in the key failed."""

    key_span: Span
    value: TreeNode
    key_resolved: bool = True

    def with_value(self, value: TreeNode) -> Entry:
        """Return the same key with another value."""
        return Entry(self.key_span, value, self.key_resolved)


class MapNode(msgspec.Struct, frozen=True, gc=False):
    """Values by their keys, in the order of the document."""

    entries: dict[str, Entry]
    span: Span


TreeNode = ScalarNode | ListNode | MapNode | UnknownNode


def child(node: TreeNode | None, part: str | int) -> TreeNode | None:
    """Return the value under a key or an index, or None."""
    if isinstance(node, MapNode) and isinstance(part, str):
        entry = node.entries.get(part)
        return entry.value if entry is not None else None
    if isinstance(node, ListNode) and isinstance(part, int) and -1 < part < len(node.items):
        return node.items[part]
    return None


def entries_of(node: TreeNode | None) -> Mapping[str, Entry]:
    """Return the entries of a map; an empty result for anything else."""
    return node.entries if isinstance(node, MapNode) else {}


def items_of(node: TreeNode | None) -> Sequence[TreeNode]:
    """Return the items of a list; an empty result for anything else."""
    return node.items if isinstance(node, ListNode) else ()


def text_of(node: TreeNode | None) -> str:
    """Return the text of a text node; empty for anything else."""
    return node.value if isinstance(node, ScalarNode) and isinstance(node.value, str) else ""


def children(node: TreeNode) -> Sequence[tuple[str | int, TreeNode]]:
    """Return the values directly inside a map or a list, with their keys or indices."""
    if isinstance(node, MapNode):
        return [(key, entry.value) for key, entry in node.entries.items()]
    return list(enumerate(items_of(node)))


def lookup(root: TreeNode | None, path: Path) -> TreeNode | None:
    """Return the value at a path, or None."""
    node = root
    for part in path:
        node = child(node, part)
    return node


def replace_at(
    root: TreeNode | None, path: Path, value: TreeNode, made_at: Sequence[Span] = ()
) -> TreeNode:
    """Return the tree with the value at a path replaced; everything else is shared.

    Args:
        root: the tree.
        path: the path of the value.
        value: the new one.
        made_at: a place for each key of the path: maps and keys that are missing are made there.
    """
    if not path:
        return value
    part = path[0]
    changed = replace_at(child(root, part), path[1:], value, made_at[1:])
    if isinstance(root, ListNode):
        items = list(root.items)
        items[int(part)] = changed
        return ListNode(tuple(items), root.span)
    entries = dict(entries_of(root))
    old = entries.get(str(part))
    entries[str(part)] = Entry(made_at[0], changed) if old is None else old.with_value(changed)
    return MapNode(entries, root.span if isinstance(root, MapNode) else made_at[0])


def without(node: MapNode, key: str) -> MapNode:
    """Return the map without a key."""
    entries = {name: entry for name, entry in node.entries.items() if name != key}
    return MapNode(entries, node.span)


def span_at(root: TreeNode, path: Path, *, key: bool = False) -> Span:
    """Return the place of the value at a path, or, with `key`, of its key.

    If the path does not exist, it is the key of the nearest ancestor that does; for the document
    itself, its first key.
    """
    node = root
    key_span = _first_key_span(root)
    for part in path:
        below = child(node, part)
        if below is None:
            return key_span
        key_span = node.entries[str(part)].key_span if isinstance(node, MapNode) else below.span
        node = below
    return key_span if key or node is root else node.span


def _first_key_span(root: TreeNode) -> Span:
    if isinstance(root, MapNode) and root.entries:
        return next(iter(root.entries.values())).key_span
    return root.span


def to_plain(root: TreeNode) -> Any:
    """Return the tree as dicts, lists and scalars; unknown values become None. Sharing is kept."""
    known: dict[int, Any] = {}

    def plain(node: TreeNode) -> Any:
        if isinstance(node, ScalarNode):
            return node.value
        if isinstance(node, UnknownNode):
            return None
        done = known.get(id(node))
        if done is None:
            if isinstance(node, MapNode):
                done = {key: plain(entry.value) for key, entry in node.entries.items()}
            else:
                done = [plain(item) for item in node.items]
            known[id(node)] = done
        return done

    return plain(root)
