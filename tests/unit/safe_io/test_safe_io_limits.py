"""Promise: every limit on what is read is in one table, with its reason, and is used."""

from __future__ import annotations

import ast
from pathlib import Path

import r2bspec
from r2bspec.safe_io import limits

PACKAGE = Path(r2bspec.__file__).parent
READERS = {"read_bytes", "read_text", "read_json", "ByteBudget"}


def names_of(tree: ast.AST) -> set[str]:
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def test_every_limit_has_a_reason_and_a_reader() -> None:
    table = ast.parse(Path(limits.__file__).read_text()).body
    rows = [row for row in table if isinstance(row, ast.AnnAssign)]
    for row in rows:
        reason = table[table.index(row) + 1]
        assert isinstance(reason, ast.Expr), ast.unparse(row)
    used = set[str]().union(*(names_of(ast.parse(file.read_text())) for file in MODULES))
    assert {ast.unparse(row.target) for row in rows} <= used


def test_no_reader_has_a_limit_of_its_own() -> None:
    for file in MODULES:
        tree = ast.parse(file.read_text())
        constants = {
            name
            for node in tree.body
            if isinstance(node, ast.Assign | ast.AnnAssign)
            for name in names_of(node.target if isinstance(node, ast.AnnAssign) else node)
        }
        for call in ast.walk(tree):
            if isinstance(call, ast.Call) and ast.unparse(call.func) in READERS:
                given = [word.value for word in call.keywords if word.arg == "max_bytes"]
                for value in (*given, *(call.args if "Budget" in ast.unparse(call.func) else ())):
                    place = f"{file}:{value.lineno}"
                    assert not isinstance(value, ast.Constant), place
                    assert not names_of(value) & constants, place


MODULES = [file for file in PACKAGE.rglob("*.py") if file != Path(limits.__file__)]
