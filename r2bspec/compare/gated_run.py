"""A run that is compared with earlier ones: run, judged, confirmed if it fails, and stored."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec

from r2bspec.compare.history import open_history
from r2bspec.compare.history_gate import add_to_history, baseline_from_history, write_baseline
from r2bspec.judge.baseline_comparison import fails_by_history
from r2bspec.judge.judge_run import result_of, to_json
from r2bspec.judge.result import Result
from r2bspec.plan.plan import Plan
from r2bspec.record.baseline_file import CONFIRMATION_FOLDER, BaselineRecord
from r2bspec.record.run_folder import RunFolder, open_run

RunPlan = Callable[[RunFolder, Plan], Result]
"""Runs a plan, into a folder."""


def run_with_baseline(
    run_plan: RunPlan,
    plan: Plan,
    folder: RunFolder,
    *,
    history: Path | None,
    stored: BaselineRecord | None,
) -> Result:
    """Run a benchmark and judge it by earlier runs.

    Args:
        run_plan: makes a run.
        plan: of the run.
        folder: of the run.
        history: gates the run, and stores it.
        stored: advisory, where there is no history.

    Raises:
        HistoryError: the history cannot be used; this is checked before the run.
        RunError: the run failed.
    """
    if history is not None:
        with open_history(history, create=True):
            pass
    result = run_plan(folder, plan)
    baseline = baseline_from_history(history, open_run(folder.path)) if history else stored
    if baseline is None:
        return result
    write_baseline(folder.path, baseline)
    result = _judge(folder)
    if fails_by_history(result.verdict) and plan.gate.confirm:
        # The second run confirms the comparison with the history only.
        once = msgspec.structs.replace(plan.gate, confirm=False)
        with RunFolder.create(folder.path / CONFIRMATION_FOLDER) as confirmation:
            run_plan(confirmation, msgspec.structs.replace(plan, gate=once))
        result = _judge(folder)
    if history is not None:
        add_to_history(history, open_run(folder.path), result)
    return result


def _judge(folder: RunFolder) -> Result:
    result = result_of(open_run(folder.path))
    folder.write_result(to_json(result))
    return result
