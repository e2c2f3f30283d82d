"""A list or a map while it is being read."""

from __future__ import annotations

import msgspec

from r2bspec.diagnostics import Edit, Related, Span
from r2bspec.diagnostics.quote import quote
from r2bspec.language.diagnostic_collector import DiagnosticCollector
from r2bspec.language.located_tree import (
    Entry,
    ListNode,
    MapNode,
    ScalarNode,
    TreeNode,
    UnknownNode,
)
from r2bspec.language.merge_key import Merge, merge_entries

_TYPE_NAMES = {bool: "a boolean", int: "a number", float: "a number"}


class CollectionBuilder(msgspec.Struct):
    """A list or a map whose end has not been read yet.

    Attributes:
        size: keys and values in it so far, with aliases expanded.
        key: in a map, the key whose value comes next.
    """

    start: Span
    anchor: str | None
    is_map: bool
    problems: DiagnosticCollector
    size: int = 1
    items: list[TreeNode] = msgspec.field(default_factory=list)
    entries: dict[str, Entry] = msgspec.field(default_factory=dict)
    merges: list[Merge] = msgspec.field(default_factory=list)
    key: TreeNode | None = None

    def add(self, node: TreeNode, size: int, span: Span) -> None:
        """Add the next node: an item, a key or a value.

        Args:
            node: the next node.
            size: keys and values in it.
            span: its place; for an alias, the place of the alias.
        """
        self.size += size
        if not self.is_map:
            self.items.append(node)
        elif self.key is None:
            self.key = node
        else:
            key, self.key = self.key, None
            self._add_entry(key, node, span)

    def last(self) -> TreeNode | None:
        """The last value."""
        if not self.is_map:
            return self.items[-1] if self.items else None
        return next(reversed(self.entries.values())).value if self.entries else None

    def node(self, span: Span) -> TreeNode:
        """The finished collection."""
        if not self.is_map:
            return ListNode(tuple(self.items), span)
        return MapNode(
            merge_entries(self.merges, self.entries) if self.merges else self.entries, span
        )

    def _add_entry(self, key: TreeNode, value: TreeNode, span: Span) -> None:
        if not isinstance(key, ScalarNode):
            if not isinstance(key, UnknownNode):
                message = "a key must be a string, not a list or a map"
                self.problems.error("R2B024", message, key.span)
            return
        if key.text == "<<" and not key.style:
            self._add_merge(key, value, span)
            return
        name = key.value
        if not isinstance(name, str):
            self._reject_key(key)
            self.entries.setdefault(key.text, Entry(key.span, value, key_resolved=False))
            return
        earlier = self.entries.get(name)
        if earlier is not None:
            self.problems.error(
                "R2B023",
                f"duplicate key {quote(name)}",
                key.span,
                "remove or rename one of them",
                related=(Related("first used here", earlier.key_span),),
            )
            return
        self.entries[name] = Entry(key.span, value)

    def _add_merge(self, key: ScalarNode, value: TreeNode, span: Span) -> None:
        if self.merges:
            self.problems.error(
                "R2B028",
                "duplicate merge key '<<'",
                key.span,
                "merge several maps with a list: '<<: [*a, *b]'",
            )
            return
        for part in value.items if isinstance(value, ListNode) else (value,):
            if isinstance(part, MapNode):
                self.merges.append(Merge(key.span, part))
            elif not isinstance(part, UnknownNode):
                self.problems.error(
                    "R2B028",
                    "'<<' can merge only maps",
                    span,
                    "write '<<: *name', where '&name' is the anchor of a map",
                )

    def _reject_key(self, key: ScalarNode) -> None:
        what = _TYPE_NAMES.get(type(key.value), "null")
        text = f'"{key.text}"'
        self.problems.error(
            "R2B024",
            f"a key must be a string; {quote(key.text)} is {what}",
            key.span,
            f"quote it: {text}" if key.text else "write a key before the ':'",
            edit=Edit(key.span, text) if key.text else None,
        )
