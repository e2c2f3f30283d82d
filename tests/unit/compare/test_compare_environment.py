"""Promise: the record of a comparison has no secret of the environment that the base ran in."""

from __future__ import annotations

from pathlib import Path

from r2bspec.compare.interleaved_runs import (
    ComparisonSide,
    ComparisonSpec,
    JudgedSession,
    _PairRunner,
)
from r2bspec.execute.progress import NullProgress
from r2bspec.execute.states import Interrupts
from r2bspec.record.comparison_folder import ComparisonFolder
from run_simulation import Simulation


def never_judged(_: bool) -> JudgedSession:
    raise AssertionError


def test_values_of_secrets_are_not_recorded(tmp_path: Path) -> None:
    plan = Simulation().plan()
    environment = {"API_TOKEN": "very-secret", "OMP_NUM_THREADS": "4", "GONE_KEY": ""}
    comparison = ComparisonSpec(
        base=ComparisonSide(plan, tmp_path, "", environment),
        head=ComparisonSide(plan, tmp_path, ""),
        pairs=1,
        against="env:API_TOKEN=***",
    )
    folder = ComparisonFolder.create(tmp_path / "pairs")
    with Interrupts() as interrupts:
        record = _PairRunner(
            comparison, folder, NullProgress(), interrupts, never_judged
        )._write_record("not begun")
    assert record.environment == {"API_TOKEN": "***", "OMP_NUM_THREADS": "4", "GONE_KEY": ""}
    assert "very-secret" not in (tmp_path / "pairs" / "pairs.json").read_text()
