"""One map laid over another: maps are merged, everything else is replaced, null removes."""

from __future__ import annotations

from r2bspec.language.located_tree import Entry, MapNode, ScalarNode, TreeNode


def overlay(base: MapNode, own: MapNode) -> MapNode:
    """What `own` says, over what `base` says; every value keeps the place where it was written.

    Keys stand in the order of `base`, then those that are new. A null where `base` has nothing
    stays, so that it is reported as any key without a value.
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
