"""Keys that begin with ``x-``: for notes and anchors; the language ignores them."""

from __future__ import annotations

from r2bspec.language.declaration import Rule
from r2bspec.language.located_tree import Entry, MapNode, TreeNode

PREFIX = "x-"


def without_extensions(root: TreeNode, rule: Rule) -> TreeNode:
    """The tree without ``x-`` keys in maps whose keys `rule` defines.

    In maps whose keys are names given by the user, such a key is an ordinary name. Shared values
    stay shared.
    """
    done: dict[tuple[int, int], TreeNode] = {}

    def strip(node: TreeNode, rule: Rule | None) -> TreeNode:
        if rule is None or not isinstance(node, MapNode):
            return node
        name = (id(node), id(rule))
        if name not in done:
            done[name] = strip_map(node, rule)
        return done[name]

    def strip_map(node: MapNode, rule: Rule) -> MapNode:
        known = rule.keys
        entries: dict[str, Entry] = {}
        changed = False
        for key, entry in node.entries.items():
            if known is not None and key.startswith(PREFIX):
                changed = True
                continue
            if type(entry.value) is MapNode:
                value = strip(entry.value, rule.below(key))
                if value is not entry.value:
                    changed = True
                    entry = Entry(entry.key_span, value, entry.key_resolved)
            entries[key] = entry
        return MapNode(entries, node.span) if changed else node

    return strip(root, rule)
