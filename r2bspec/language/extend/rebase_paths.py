"""Rewriting the paths in a document of another folder, so that they refer to the same files.

A path is relative to the file in which it is written. Arguments of command lines are not
rewritten: which of them are paths is unknown.
"""

from __future__ import annotations

import posixpath
from typing import Any

from msgspec.structs import replace

from r2bspec.language.located_tree import Entry, ListNode, MapNode, ScalarNode, TreeNode
from r2bspec.language.schema.schema_builder import PATH
from r2bspec.language.variable_references import OPENING

_FILE_AND_NAME = ".py:"


def rebase_paths(node: TreeNode, rule: Any, folder: str) -> TreeNode:
    """The tree with `folder` put before every relative path; `rule` is the schema of the node."""
    if not isinstance(rule, dict):
        return node
    if isinstance(node, ScalarNode):
        return _scalar(node, folder) if rule.get(PATH) else node
    if isinstance(node, ListNode):
        items = tuple(rebase_paths(item, rule.get("items"), folder) for item in node.items)
        return ListNode(items, node.span)
    if isinstance(node, MapNode):
        known = rule.get("properties", {})
        other = rule.get("additionalProperties")
        return MapNode(
            {
                key: Entry(
                    entry.key_span,
                    rebase_paths(entry.value, known.get(key, other), folder),
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
