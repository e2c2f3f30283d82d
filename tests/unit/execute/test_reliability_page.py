"""Promise: each promise in docs/reliability.md names a test, and that test is there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs" / "reliability.md"
NAMED = sorted(set(re.findall(r"`(tests/\S+?\.py)::(\w+)`", PAGE.read_text())))


@pytest.mark.parametrize(("file", "name"), NAMED, ids=[name for _, name in NAMED])
def test_a_test_that_holds_a_promise_is_there(file: str, name: str) -> None:
    functions = [
        each.name
        for each in ast.walk(ast.parse((ROOT / file).read_text()))
        if isinstance(each, ast.FunctionDef)
    ]
    assert name in functions


def test_every_promise_names_a_test() -> None:
    rows = [
        line
        for line in PAGE.read_text().splitlines()
        if line.startswith("| ") and not line.startswith(("| ---", "| what ", "| promise "))
    ]
    assert len(rows) > 30
    assert [row for row in rows if "`tests/" not in row] == []


def test_every_module_of_fault_tests_is_on_the_page() -> None:
    modules = {f"tests/fault/{each.name}" for each in (ROOT / "tests/fault").glob("test_*.py")}
    assert modules <= {file for file, _ in NAMED}
