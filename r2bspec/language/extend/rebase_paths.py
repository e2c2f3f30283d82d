"""Rewriting the paths in a document of another folder, so that they refer to the same files.

A path is relative to the file in which it is written. Arguments of command lines are not
rewritten: which of them are paths is unknown.
"""

from __future__ import annotations

import posixpath

from msgspec.structs import replace

from r2bspec.language.declaration import Rule
from r2bspec.language.located_tree import Entry, ListNode, MapNode, ScalarNode, TreeNode
from r2bspec.language.variable_references import OPENING

_FILE_AND_NAME = ".py:"


def rebase_paths(node: TreeNode, rule: Rule | None, folder: str) -> TreeNode:
    """The tree with `folder` put before every relative path; `rule` is that of the node."""
    if rule is None:
        return node
    if isinstance(node, ScalarNode):
        return _scalar(node, folder) if rule.about.path else node
    if isinstance(node, ListNode):
        items = tuple(rebase_paths(item, rule.items, folder) for item in node.items)
        return ListNode(items, node.span)
    if isinstance(node, MapNode):
        return MapNode(
            {
                key: Entry(
                    entry.key_span,
                    rebase_paths(entry.value, rule.below(key), folder),
                    entry.key_resolved,
                )
                for key, entry in node.entries.items()
            },
            node.span,
        )
    return node


def _scalar(node: ScalarNode, folder: str) -> ScalarNode:
    text = node.value
    if not isinstance(text, str) or not text or text.startswith(("/", OPENING)):
        return node
    # A single word may be the name of a dataset or of a module; a path begins with './'.
    if not text.startswith(".") and "/" not in text and not text.endswith((".yaml", ".yml")):
        return node
    if ":" in text and _FILE_AND_NAME not in text:
        return node
    moved = posixpath.normpath(posixpath.join(folder, text))
    if not moved.startswith((".", "/")):
        moved = f"./{moved}"
    return replace(node, value=moved, text=moved)
