"""Values as they are written: variables, and words that YAML 1.1 reads differently.

These rules look at the text of the document and at its variables, before anything is resolved: they
tell an author why a value does not arrive as intended.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, rule, value_key
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import quote
from r2bspec.language.located_tree import ScalarNode, TreeNode, children

_BOOLEAN_WORDS = frozenset({"yes", "no", "on", "off", "y", "n"})
_OCTAL = re.compile(r"[-+]?0[0-7_]+")
_SEXAGESIMAL = re.compile(r"[-+]?[1-9][0-9_]*(:[0-5]?[0-9])+(\.[0-9_]*)?")
_UNTYPED_SECTIONS = frozenset({"parameters", "arguments", "variables", "labels", "request"})
_TRUE_WORDS = frozenset({"yes", "on", "y"})


@rule("R2B603")
def yaml_1_1_value(context: Context) -> Findings:
    """Find values that YAML 1.1 reads differently."""
    if context.loaded.tree is None:
        return
    for path, node in _plain_strings(context.loaded.tree, (), inside=False):
        reading = _yaml_1_1_value(node.text)
        if reading is not None:
            yield Finding(
                message=f"{quote(node.text)} is a string here, but {reading[0]} in YAML 1.1",
                path=path,
                help=f"write {reading[1]}, or put the string in quotes",
            )


def _plain_strings(
    node: TreeNode, path: Path, *, inside: bool
) -> Iterator[tuple[Path, ScalarNode]]:
    """Strings without quotes, where a node or a variable also accepts a number."""
    if isinstance(node, ScalarNode):
        if inside and isinstance(node.value, str) and not node.style and node.origin is None:
            yield path, node
        return
    for step, value in children(node):
        below = inside or step in _UNTYPED_SECTIONS
        # Most values are single ones in other sections.
        if below or type(value) is not ScalarNode:
            yield from _plain_strings(value, (*path, step), inside=below)


def _yaml_1_1_value(text: str) -> tuple[str, str] | None:
    """Return the meaning in YAML 1.1, and how to write it in YAML 1.2; None if it is the same."""
    if text.lower() in _BOOLEAN_WORDS and text in {text.lower(), text.upper(), text.capitalize()}:
        return "a boolean", "true" if text.lower() in _TRUE_WORDS else "false"
    if _OCTAL.fullmatch(text):
        return "an octal number", str(int(text.replace("_", ""), 8))
    if _SEXAGESIMAL.fullmatch(text):
        return "a base-60 number", "a decimal number"
    return None


@rule("R2B606")
def matrix_variable_unused(context: Context) -> Findings:
    """Find variables of a matrix that are not used."""
    matrix_case = context.loaded.matrix_case
    for name in matrix_case.values if matrix_case is not None else ():
        if name not in context.loaded.used_variables:
            yield Finding(
                message=f"matrix variable {quote(name)} is not used",
                path=("variables", name),
                help=f"use it with {quote(f'$(var {name})')}, or remove it from the matrix",
                suppresses={value_key(("variables", name))},
            )


@rule("R2B616")
def variable_unused(context: Context) -> Findings:
    """Find variables that are not used."""
    for name in context.spec.variables:
        if name not in context.loaded.used_variables:
            yield Finding(
                message=f"variable {quote(name)} is not used",
                path=("variables", name),
                key=True,
                help=f"use it with {quote(f'$(var {name})')}, or remove it",
                suppressed_by={value_key(("variables", name))},
            )
