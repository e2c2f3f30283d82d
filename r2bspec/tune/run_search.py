"""A search for the values of a spec: its folder, its trials, its result and its files."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from r2bspec import api
from r2bspec.errors import UsageError
from r2bspec.execute.processes.machine import describe_machine
from r2bspec.execute.states import Progress
from r2bspec.extras import install_command
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.plan.canonical_json import plan_hash
from r2bspec.record.files import FolderTakenError, write_atomically
from r2bspec.report.markdown import to_markdown
from r2bspec.safe_io.private_files import private_files
from r2bspec.tune.machine import RealMachine, TuningError, goal_of
from r2bspec.tune.overlay import write_overlay
from r2bspec.tune.search import Search, SearchLimits
from r2bspec.tune.space import Space
from r2bspec.tune.tuning_result import TuningResult, tuning_document, write_tuning

RUNS_FOLDER: Final = "trials"
PAGE_FILE: Final = "tuning.md"


def tune(
    selection: SpecSelection,
    prepared: api.PreparedBenchmark,
    folder: Path,
    limits: SearchLimits,
    *,
    minimize: str,
    write: Path | None = None,
    progress: Progress | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> TuningResult:
    """Search for the listed values of a spec that meet its objectives at the least cost.

    The caller has checked that the extra is installed (`require_extra`), and has the lock of the
    host.

    Args:
        selection: the selection of the spec.
        prepared: from it.
        folder: receives the result and all runs; new or empty.
        limits: how long the search may take.
        minimize: the metric that is to be least.
        write: the overlay to write if values are proved.
        progress: is notified of the progress of each run.
        tell: is called with a line after each step.

    Raises:
        TuningError: the spec has no objective, or no values to try.
        FolderTakenError: the folder has files.
        InterruptedRunError: a signal ended a run.
        UsageError: the overlay cannot be written.
    """
    spec = prepared.loaded.spec if prepared.loaded is not None else None
    if spec is None:
        raise TuningError(f"{selection.spec} is a plan", hint="Give the spec.")
    goal = goal_of(prepared.plan, minimize)
    if not any(objective.level == "error" for objective in prepared.plan.objectives.values()):
        raise TuningError(
            f"{selection.spec} has no objective that values would have to meet",
            hint="Add one under slos; 'r2bspec judge RUN --suggest SPEC' proposes some.",
        )
    if not spec.tune.values:
        raise TuningError(
            f"{selection.spec} lists no values to try",
            hint="For example: tune: {values: {graph.nodes.NODE.threads: [1, 2]}}.",
        )
    if folder.exists() and any(folder.iterdir()):
        raise FolderTakenError(f"{folder} is not empty", hint="Name a new folder.")
    space = Space(spec.tune.values)
    with private_files():
        (folder / RUNS_FOLDER).mkdir(parents=True, exist_ok=True)
        machine = RealMachine(selection, space, folder / RUNS_FOLDER, goal, progress or Progress())
        result = TuningResult(
            name=prepared.plan.name,
            goal=goal.text,
            goal_unit=goal.unit,
            values=spec.tune.values,
            trials=(),
            outcome="incomplete",
            reason="The search has not ended.",
            started_at=datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
            plan=plan_hash(prepared.plan),
            machine=dict(describe_machine()),
        )
        began_s = machine.now()

        def so_far() -> TuningResult:
            duration_s = machine.now() - began_s
            return replace(result, trials=tuple(search.trials), duration_s=duration_s)

        def after_step(line: str) -> None:
            write_tuning(folder, so_far())
            tell(line)

        search = Search(space, machine, limits, after_step)
        search_result = search.run()
        result = replace(
            so_far(),
            outcome=search_result.outcome,
            reason=search_result.reason,
            winner=space.changes(search_result.winner)
            if search_result.winner is not None
            else None,
            proof=search_result.proof,
        )
        write_tuning(folder, result)
        write_atomically(folder / PAGE_FILE, to_markdown(tuning_document(result)).encode())
    if write is not None and result.is_proved and search_result.winner is not None:
        plan = machine.prepare(search_result.winner).plan
        about = f"Values that 'r2bspec tune' has proved. {result.reason}"
        write_overlay(write, selection, space.changes(search_result.winner), plan, about)
    return result


def require_extra() -> None:
    """Check that the extra `tune` is installed, before anything is waited for.

    Raises:
        UsageError: it is not.
    """
    if find_spec("optuna") is None:
        raise UsageError(
            "the search needs optuna, which this installation does not have",
            hint=f"Install it: {install_command('tune')}.",
        )
