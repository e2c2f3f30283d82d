"""Every exit status is written once, in `r2bspec.exit_status`."""

from __future__ import annotations

import ast
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import click
import msgspec
import pytest

from r2bspec.cli import main as cli
from r2bspec.exit_status import ExitStatus
from r2bspec.judge.verdict import EXIT_CODES, OverallOutcome, Verdict

ROOT = Path(__file__).parents[3]
PACKAGE = ROOT / "r2bspec"
PAGE = ROOT / "docs" / "running.md"
MODULES = sorted(each for each in PACKAGE.rglob("*.py") if each.name != "exit_status.py")

_EXITING = {"exit", "_exit", "SystemExit", "Exit"}
_ENTRIES = {"main", "command", "play_role"}


def literal_statuses(source: str, *, command_line: bool = False) -> Iterator[int]:
    """The lines on which a status is written as a number."""
    for node in ast.walk(ast.parse(source)):
        values: list[ast.expr | None] = []
        match node:
            case ast.Assign(targets=[ast.Name(id="exit_code")]):
                values = [node.value]
            case ast.AnnAssign(target=ast.Name(id="exit_code")):
                values = [node.value]
            case ast.keyword(arg="exit_code"):
                values = [node.value]
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) if name in _EXITING:
                values = list(node.args)
            case ast.Compare(left=ast.Attribute(attr="exit_code")):
                # 0 is success for every process, also for those of others.
                values = [each for each in node.comparators if not _is_zero(each)]
            case ast.FunctionDef() if command_line or node.name in _ENTRIES:
                returns = [each for each in ast.walk(node) if isinstance(each, ast.Return)]
                values = [each.value for each in returns]
        for value in values:
            if value is not None and _has_number(value):
                yield value.lineno


def _is_zero(value: ast.expr) -> bool:
    return isinstance(value, ast.Set | ast.Tuple) or (
        isinstance(value, ast.Constant) and value.value == 0
    )


def _has_number(value: ast.expr) -> bool:
    """Whether a number, or a choice between numbers, is what an expression comes to."""
    if isinstance(value, ast.IfExp):
        return _has_number(value.body) or _has_number(value.orelse)
    return isinstance(value, ast.Constant) and type(value.value) is int


def test_no_module_writes_a_status_as_a_number() -> None:
    lines = {
        str(module.relative_to(PACKAGE)): list(
            literal_statuses(
                module.read_text(), command_line=module.is_relative_to(PACKAGE / "cli")
            )
        )
        for module in MODULES
    }
    assert {name: found for name, found in lines.items() if found} == {}


@pytest.mark.parametrize(
    "source",
    [
        "class E(R2bspecError):\n    exit_code = 2",
        "class E(R2bspecError):\n    exit_code: int = 2",
        "verdict = Verdict(exit_code=3)",
        "sys.exit(1)",
        "os._exit(1 if failed else 0)",
        "raise SystemExit(2)",
        "ctx.exit(0)",
        "if error.exit_code == 130: pass",
        "def main():\n    return 1",
        "def play_role():\n    return OK if found else 1",
    ],
)
def test_a_number_would_be_found(source: str) -> None:
    assert len(list(literal_statuses(source))) == 1


def test_the_numbers_are_the_promised_ones() -> None:
    assert {each.name: each.value for each in ExitStatus} == {
        "OK": 0,
        "FINDINGS_OR_FAILED": 1,
        "USAGE": 2,
        "INCONCLUSIVE": 3,
        "RUN_FAILED": 4,
        "INTERNAL_ERROR": 70,
        "INTERRUPTED": 130,
        "OUTPUT_CLOSED": 141,
    }


def test_the_help_lists_every_status(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--help"]) == ExitStatus.OK
    shown = " ".join(capsys.readouterr().out.split())
    for each in ExitStatus:
        assert f"{each.value} {each.meaning}" in shown


def test_no_help_writes_a_status_as_a_number() -> None:
    with click.Context(cli.command) as ctx:
        commands = {name: cli.command.get_command(ctx, name) for name in cli._VERBS}
    texts = {name: each.help or "" for name, each in commands.items() if each is not None}
    assert len(texts) == len(cli._VERBS)
    found = {name for name, text in texts.items() if re.search(r"(?:status|exits with) \d", text)}
    assert found == set()


def test_the_page_has_the_table_of_every_status() -> None:
    rows = "".join(f"| {each.value} | {each.meaning} |\n" for each in ExitStatus)
    table = f"<!-- exit statuses -->\n| status | meaning |\n| --- | --- |\n{rows}<!-- end -->"
    text = PAGE.read_text(encoding="utf-8")
    made = re.sub(r"<!-- exit statuses -->.*?<!-- end -->", table, text, flags=re.DOTALL)
    assert table in made
    if os.environ.get("R2BSPEC_REWRITE"):
        PAGE.write_text(made, encoding="utf-8")
    assert made == PAGE.read_text(encoding="utf-8"), "run this test with R2BSPEC_REWRITE=1"


@pytest.mark.parametrize("outcome", ["pass", "fail", "inconclusive", "invalid"])
def test_the_page_on_verdicts_has_their_statuses(outcome: OverallOutcome) -> None:
    text = (ROOT / "docs" / "verdicts.md").read_text(encoding="utf-8")
    row = rf"^\| {outcome.upper()} \| .* \| {EXIT_CODES[outcome].value} \|$"
    assert re.search(row, text, re.MULTILINE)


def test_every_outcome_has_a_status_and_is_stored_as_a_number() -> None:
    assert set(EXIT_CODES) == set(get_args(OverallOutcome))
    for outcome, status in EXIT_CODES.items():
        verdict = Verdict(
            outcome=outcome, exit_code=status, reason="", requirements=(), unusable=()
        )
        assert f'"exit_code":{status.value},'.encode() in msgspec.json.encode(verdict)
