"""The kinds of node are listed once."""

from __future__ import annotations

from typing import get_args

from r2bspec.language.node_kinds import (
    NODE_KIND_KEYS,
    NODE_KINDS,
    NodeKindName,
    kinds_help,
    kinds_text,
)
from r2bspec.language.spec import Node
from r2bspec.plan import command_lines


def test_the_table_is_complete() -> None:
    assert [each.name for each in NODE_KINDS] == list(get_args(NodeKindName))
    assert set(NODE_KIND_KEYS) <= set(Node.__struct_fields__)
    assert set(command_lines._ARGV) == {each.name for each in NODE_KINDS if each.role is not None}


def test_the_kinds_in_words() -> None:
    assert kinds_text() == (
        "'python', 'package' with 'plugin', 'package' with 'executable', 'command', 'launch', or "
        "'external'"
    )
    assert kinds_help() == (
        "'python', 'package' with 'plugin' or 'executable', 'command', 'launch', or "
        "'external: true'"
    )
