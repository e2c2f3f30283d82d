"""Promise: every limit on what is read is in one table, with its reason, and is used."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import r2bspec
from r2bspec.safe_io import limits

TABLE = Path(limits.__file__)
TEXTS = {
    file: file.read_text() for file in Path(r2bspec.__file__).parent.rglob("*.py") if file != TABLE
}
READERS = {"read_bytes", "read_text", "read_json", "ByteBudget"}


def names_of(tree: ast.AST) -> set[str]:
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def test_every_limit_has_a_reason_and_a_reader() -> None:
    table = ast.parse(TABLE.read_text()).body
    rows = [row for row in table if isinstance(row, ast.AnnAssign)]
    for row in rows:
        reason = table[table.index(row) + 1]
        assert isinstance(reason, ast.Expr), ast.unparse(row)
    used = set[str]().union(*(re.findall(r"\w+", text) for text in TEXTS.values()))
    assert {ast.unparse(row.target) for row in rows} <= used


def test_no_reader_has_a_limit_of_its_own() -> None:
    for file, text in TEXTS.items():
        if not READERS & set(re.findall(r"\w+", text)):
            continue
        tree = ast.parse(text)
        constants = {
            name
            for node in tree.body
            if isinstance(node, ast.Assign | ast.AnnAssign)
            for name in names_of(node)
            if name.isupper()
        }
        calls = [
            node
            for node in ast.walk(tree)
            if isinstance(node, ast.Call) and ast.unparse(node.func) in READERS
        ]
        for call in calls:
            given = [word.value for word in call.keywords if word.arg == "max_bytes"]
            for value in given + call.args * (ast.unparse(call.func) == "ByteBudget"):
                assert not isinstance(value, ast.Constant), (file, value.lineno)
                assert not names_of(value) & constants, (file, value.lineno)
