"""Merging of two maps: nested maps are merged, other values replaced, null removes a key."""

from __future__ import annotations

from r2bspec.language.located_tree import Entry, MapNode, ScalarNode, TreeNode


def overlay(base: MapNode, own: MapNode) -> MapNode:
    """`own` merged over `base`; every value keeps the place where it is written.

    The keys of `base` come first, then the new ones. A null for a key that `base` does not have is
    kept, so that it is reported like any key without a value.
    """
    entries = dict(base.entries)
    for key, entry in own.entries.items():
        below = entries.get(key)
        if below is None:
            entries[key] = entry
        elif _is_null(entry.value):
            del entries[key]
        elif isinstance(entry.value, MapNode) and isinstance(below.value, MapNode):
            entries[key] = Entry(
                entry.key_span, overlay(below.value, entry.value), entry.key_resolved
            )
        else:
            entries[key] = entry
    return MapNode(entries, own.span)


def _is_null(node: TreeNode) -> bool:
    return isinstance(node, ScalarNode) and node.value is None
