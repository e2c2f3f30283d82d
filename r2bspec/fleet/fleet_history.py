"""Runs of a fleet judged by the history: each by the earlier runs of its own host."""

from __future__ import annotations

from pathlib import Path

import msgspec

from r2bspec.compare.history import open_history
from r2bspec.compare.history_gate import add_to_history, baseline_from_history, write_baseline
from r2bspec.judge.history_comparison import fails_by_history
from r2bspec.judge.judge_run import result_of, to_json
from r2bspec.judge.result import Result
from r2bspec.plan.plan import Plan
from r2bspec.record.run_folder import RunFolder, open_run


class FleetHistory:
    """The history of a client, as `r2bspec.compare.gated_run` uses it for a run on this machine.

    The machine is part of what a run is compared by, so each host has a history of its own.
    """

    def __init__(self, file: Path) -> None:
        """See that the history can be used.

        Raises:
            HistoryError: it cannot.
        """
        self._file = file
        with open_history(file, create=True):
            pass

    def confirmation(self, folder: Path, plan: Plan) -> Plan | None:
        """Judge a run by the history; the plan of the run that must confirm a failure, if any."""
        baseline = baseline_from_history(self._file, open_run(folder))
        write_baseline(folder, baseline)
        if not fails_by_history(_judged(folder).verdict) or not plan.gate.confirm:
            return None
        # The second run confirms the comparison with the history only.
        gate = msgspec.structs.replace(plan.gate, confirm=False)
        return msgspec.structs.replace(plan, gate=gate)

    def add(self, folder: Path) -> None:
        """Judge a run with its confirmation, and add it to the history."""
        add_to_history(self._file, open_run(folder), _judged(folder))


def _judged(folder: Path) -> Result:
    result = result_of(open_run(folder))
    RunFolder(folder).write_result(to_json(result))
    return result
