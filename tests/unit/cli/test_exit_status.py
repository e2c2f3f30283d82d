"""Every exit status has its number and its meaning."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import get_args

import msgspec
import pytest

from command_line import Call
from r2bspec.errors import ExitStatus
from r2bspec.judge.verdict import EXIT_CODES, OverallOutcome, Verdict

ROOT = Path(__file__).parents[3]
PACKAGE = ROOT / "r2bspec"
PAGE = ROOT / "docs" / "running.md"


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


def test_the_help_lists_every_status(call: Call) -> None:
    shown = " ".join(call("--help", status=ExitStatus.OK).out.split())
    for each in ExitStatus:
        assert f"{each.value} {each.meaning}" in shown


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


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&- <&-"])
@pytest.mark.parametrize(("words", "status"), [("explain", 0), ("validate none.r2b.yaml", 2)])
def test_a_stream_that_is_closed_changes_no_status(
    words: str, status: int, closed: str, tmp_path: Path
) -> None:
    program = shlex.quote(sys.executable)
    ended = subprocess.run(
        ["/bin/sh", "-c", f"{program} -m r2bspec {words} {closed}"],
        cwd=tmp_path,
        capture_output=True,
        check=False,
    )
    assert ended.returncode == status, ended.stderr
    assert list(tmp_path.iterdir()) == []
