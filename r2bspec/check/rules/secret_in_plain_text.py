"""Secrets in plain text."""

from __future__ import annotations

import re

from r2bspec.check.rule_api import Context, Finding, Findings, Path, Rule, quote
from r2bspec.language.environment_access import is_secret_key
from r2bspec.language.located_tree import ListNode, MapNode, ScalarNode, TreeNode

_SECTIONS = frozenset({"env", "parameters", "arguments", "variables", "request", "labels"})
_PLACEHOLDERS = frozenset({"", "none", "null", "true", "false", "changeme", "xxx", "***"})


def _find(context: Context) -> Findings:
    if context.loaded.tree is not None:
        yield from _secrets_below(context.loaded.tree, (), inside=False)


def _secrets_below(node: TreeNode, path: Path, *, inside: bool) -> Findings:
    if isinstance(node, ListNode):
        for index, item in enumerate(node.items):
            if type(item) is not ScalarNode:
                yield from _secrets_below(item, (*path, index), inside=inside)
    if not isinstance(node, MapNode):
        return
    for key, entry in node.entries.items():
        entry_path = (*path, key)
        if not inside or not is_secret_key(key):
            if type(entry.value) is not ScalarNode:
                below = inside or key in _SECTIONS
                yield from _secrets_below(entry.value, entry_path, inside=below)
        elif _is_secret(entry.value):
            name = re.sub(r"\W", "_", key).upper()
            yield Finding(
                message=f"{quote(key)} looks like a secret in plain text",
                path=entry_path,
                help=f"write $(env {name}), list {name} under 'environment', and set it in the "
                "environment of the run",
            )


def _is_secret(node: TreeNode) -> bool:
    """Whether a string is written in the file, rather than taken from the environment."""
    if isinstance(node, MapNode):
        return any(_is_secret(each.value) for key, each in node.entries.items() if key == "value")
    return (
        isinstance(node, ScalarNode)
        and isinstance(node.value, str)
        and node.origin is None
        and node.text.lower() not in _PLACEHOLDERS
    )


RULE = Rule(code="R2B604", find=_find)
