"""``make demo`` fails where the demo fails, and not where only a busy machine leaves it open."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of
from r2bspec.report.format_registry import renderer
from report_runs import USUAL, skewed
from run_simulation import Played, objective

ROOT = Path(__file__).parents[2]

MAKE = shutil.which("make") or ""

pytestmark = pytest.mark.skipif(not MAKE, reason="make is not installed")


@pytest.fixture
def report(tmp_path: Path, request: pytest.FixtureRequest) -> str:
    """The report of a run that is open; the parameter says whether only because of the machine."""
    few = replace(
        USUAL,
        segments=[Played(30, skewed(20, 0.02)) for _ in range(2)],
        objectives={"fast": objective("latency.p99 < 50 ms", "latency.p95 < 50 ms")},
    )
    result = result_of(few.write(tmp_path / "run"))
    first, *others = result.verdict.requirements
    assert result.verdict.outcome == "inconclusive"
    requirements = (
        msgspec.structs.replace(first, weakened=True),
        *(msgspec.structs.replace(other, weakened=request.param) for other in others),
    )
    verdict = msgspec.structs.replace(result.verdict, requirements=requirements)
    open_run = ReportInput(result=msgspec.structs.replace(result, verdict=verdict))
    return renderer("markdown")(open_run).decode()


@pytest.mark.parametrize(
    ("report", "status", "ends_with"),
    [(True, 0, 0), (True, 1, 1), (True, 3, 0), (False, 3, 3), (True, 4, 4)],
    indirect=["report"],
)
def test_only_what_the_machine_leaves_open_is_no_failure(
    tmp_path: Path, report: str, status: int, ends_with: int
) -> None:
    (tmp_path / "report.md").write_text(report)
    program = tmp_path / "r2bspec"
    program.write_text(
        "#!/bin/sh\necho ran $*\n"
        f'for last; do :; done\ncp {tmp_path}/report.md "${{last#markdown=}}"\nexit {status}\n'
    )
    program.chmod(0o755)
    done = subprocess.run(
        # What it installs is left as it is.
        [MAKE, "--old-file=install", f"BIN={tmp_path}", "demo"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "ran run specs/apriltag_node.r2b.yaml" in done.stdout
    assert (done.returncode == 0) == (ends_with == 0)
    # GNU make has a status of its own, and names that of the recipe.
    assert ends_with == 0 or f"Error {ends_with}" in done.stderr
