"""The kinds of node are listed once, and the rest of the program asks for their traits."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest

from r2bspec.language.node_kinds import (
    NODE_KIND_KEYS,
    NODE_KINDS,
    NodeKindName,
    kinds_help,
    kinds_text,
)
from r2bspec.language.spec import Node
from r2bspec.plan import command_lines

PACKAGE = Path(__file__).parents[3] / "r2bspec"
MODULES = sorted(each for each in PACKAGE.rglob("*.py") if each.name != "node_kinds.py")
NAMES = set(get_args(NodeKindName))


def kinds_compared(source: str) -> Iterator[int]:
    """The lines on which the kind of a node is compared with the name of one."""
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Compare):
            continue
        sides = [node.left, *node.comparators]
        words = [
            each.value
            for side in sides
            for each in ast.walk(side)
            if isinstance(each, ast.Constant) and isinstance(each.value, str)
        ]
        if any("kind" in ast.dump(side).lower() for side in sides) and NAMES.intersection(words):
            yield node.lineno


def test_no_module_asks_for_a_kind_by_its_name() -> None:
    lines = {
        str(module.relative_to(PACKAGE)): list(kinds_compared(module.read_text()))
        for module in MODULES
    }
    assert {name: found for name, found in lines.items() if found} == {}


@pytest.mark.parametrize(
    "source",
    [
        'if node.kind == "python": pass',
        'if node.node.kind in {"python", "plugin"}: pass',
        'placed = [each for each in nodes if "launch" != each.kind.name]',
    ],
)
def test_a_comparison_would_be_found(source: str) -> None:
    assert list(kinds_compared(source))


def test_the_table_is_complete() -> None:
    assert [each.name for each in NODE_KINDS] == list(get_args(NodeKindName))
    assert set(NODE_KIND_KEYS) <= set(Node.__struct_fields__)
    assert set(command_lines._ARGV) == {each.name for each in NODE_KINDS if each.role is not None}
    suggested = [each.suggested for each in NODE_KINDS if each.snippet]
    assert sorted(suggested) == list(range(1, len(suggested) + 1))


def test_the_kinds_in_words() -> None:
    assert kinds_text() == (
        "'python', 'package' with 'plugin', 'package' with 'executable', 'command', 'launch', or "
        "'external'"
    )
    assert kinds_help() == (
        "'python', 'package' with 'plugin' or 'executable', 'command', 'launch', or "
        "'external: true'"
    )
