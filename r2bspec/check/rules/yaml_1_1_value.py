"""Values that YAML 1.1 reads differently."""

from __future__ import annotations

import re
from collections.abc import Iterator

from r2bspec.check.rule_api import Context, Finding, Findings, Path, Rule, quote
from r2bspec.language.located_tree import ListNode, MapNode, ScalarNode, TreeNode

_BOOLEAN_WORDS = frozenset({"yes", "no", "on", "off", "y", "n"})
_OCTAL = re.compile(r"[-+]?0[0-7_]+")
_SEXAGESIMAL = re.compile(r"[-+]?[1-9][0-9_]*(:[0-5]?[0-9])+(\.[0-9_]*)?")
_SECTIONS = frozenset({"parameters", "arguments", "variables", "labels", "request"})
_TRUE_WORDS = frozenset({"yes", "on", "y"})


def _find(context: Context) -> Findings:
    if context.loaded.tree is None:
        return
    for path, node in _values(context.loaded.tree, (), inside=False):
        reading = _yaml_1_1_value(node.text)
        if reading is not None:
            yield Finding(
                message=f"{quote(node.text)} is a string here, but {reading[0]} in YAML 1.1",
                path=path,
                help=f"write {reading[1]}, or put the string in quotes",
            )


def _values(node: TreeNode, path: Path, *, inside: bool) -> Iterator[tuple[Path, ScalarNode]]:
    """Strings without quotes, where a node or a variable also accepts a number."""
    if isinstance(node, ScalarNode):
        if inside and isinstance(node.value, str) and not node.style and node.origin is None:
            yield path, node
    elif isinstance(node, MapNode):
        for key, entry in node.entries.items():
            below = inside or key in _SECTIONS
            # Most values are single ones in other sections.
            if (below or type(entry.value) is not ScalarNode) and not key.startswith("x-"):
                yield from _values(entry.value, (*path, key), inside=below)
    elif isinstance(node, ListNode):
        for index, item in enumerate(node.items):
            if inside or type(item) is not ScalarNode:
                yield from _values(item, (*path, index), inside=inside)


def _yaml_1_1_value(text: str) -> tuple[str, str] | None:
    """The meaning in YAML 1.1, and how to write it in YAML 1.2; None if it is the same."""
    if text.lower() in _BOOLEAN_WORDS and text in {text.lower(), text.upper(), text.capitalize()}:
        return "a boolean", "true" if text.lower() in _TRUE_WORDS else "false"
    if _OCTAL.fullmatch(text):
        return "an octal number", str(int(text.replace("_", ""), 8))
    if _SEXAGESIMAL.fullmatch(text):
        return "a base-60 number", "a decimal number"
    return None


RULE = Rule(code="R2B603", find=_find)
