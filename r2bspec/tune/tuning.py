"""A search for a deployment of a spec on this machine, stored in a folder as it goes."""

from __future__ import annotations

import contextlib
import datetime
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import msgspec

from r2bspec import api
from r2bspec.diagnostics.quote import quoted_list
from r2bspec.errors import R2bspecError, UsageError
from r2bspec.execute.processes.machine import describe_machine
from r2bspec.execute.progress import Progress
from r2bspec.fleet.journal import Journal
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.plan.tuning_space import Deployment
from r2bspec.private_files import private_files
from r2bspec.record.files import FolderTakenError, write_atomically
from r2bspec.record.run_folder import open_run
from r2bspec.tune.fleet_machine import FleetHosts, FleetMachine
from r2bspec.tune.launch_file import launch_files
from r2bspec.tune.machine import TuningError, goal_of
from r2bspec.tune.predict import Predictor
from r2bspec.tune.search import Forecast, Predict, Search, SearchListener, SearchSettings
from r2bspec.tune.trials import RealMachine, ThisMachine
from r2bspec.tune.tuning_page import to_html
from r2bspec.tune.tuning_result import Trial, TuningResult, read_tuning, write_tuning

TRIALS_FOLDER: Final = "trials"
PAGE_FILE: Final = "tuning.html"


class _Follower(SearchListener):
    """Stores what was found after each trial, passes lines on, and predicts by today's run."""

    def __init__(self, folder: Path, machine: RealMachine, tell: Callable[[str], None]) -> None:
        self._folder, self._machine, self._tell = folder, machine, tell

    def found(self, result: TuningResult) -> None:
        """Write the result."""
        write_tuning(self._folder, result)

    def line(self, text: str) -> None:
        """Pass the line on."""
        self._tell(text)

    def predictor(self, today: Trial) -> Predict | None:
        """A model of the graph from the anatomy of today's run, if there is one."""
        if not today.run:
            return None
        unknown: set[str] = set()
        predictor = Predictor(open_run(self._machine.folder / today.run))

        @cache
        def predict(deployment: Deployment) -> Forecast | None:
            try:
                found = predictor.predict(self._machine.prepare(deployment).plan)
            except R2bspecError:
                return None
            if found.reason:
                if found.reason not in unknown:
                    unknown.add(found.reason)
                    self._tell(f"no prediction for {deployment.text}: {found.reason}")
                return None
            unsure = sum(each.answer == "not known" for each in found.requirements)
            return Forecast(rank=unsure, ruled_out=found.rules_out)

        return predict


def tune(
    selection: SpecSelection,
    prepared: api.PreparedBenchmark,
    folder: Path,
    settings: SearchSettings,
    *,
    minimize: str,
    fleet: FleetHosts | None = None,
    progress: Progress | None = None,
    tell: Callable[[str], None] = lambda _: None,
    resume: bool = False,
) -> TuningResult:
    """Search for the deployment that meets the objectives of a spec at the least cost.

    The caller has seen that the extra is there (`require_extra`), and has the lock of the host,
    unless a fleet makes the runs.

    Args:
        selection: of the spec.
        prepared: from it.
        folder: receives the result and all runs; new or empty, unless a search is resumed.
        settings: how long the search may take.
        minimize: the metric that is to be least.
        fleet: the hosts that make the runs; None for this machine.
        progress: is notified of the progress of each run.
        tell: is called with a line after each trial.
        resume: go on with the search whose trials the folder has.

    Raises:
        TuningError: the spec has no objective, or nothing that can be deployed in another way.
        FolderTakenError: the folder has files, and no search is resumed.
        InterruptedRunError: a signal ended a run; the search can be resumed.
    """
    facts = fleet.scheduling if fleet is not None else None
    space = api.tuning_space(prepared, selection, facts=facts)
    if not any(objective.level == "error" for objective in prepared.plan.objectives.values()):
        raise TuningError(
            f"{selection.spec} has no objective that a deployment would have to meet",
            hint="Add one under slos; 'r2bspec suggest' proposes some.",
        )
    if space.size < 2:
        raise TuningError(
            f"{selection.spec} can be deployed in one way only",
            hint="'r2bspec plan --tune' says what was left out and why.",
        )
    goal = goal_of(prepared.plan, minimize)
    blank = TuningResult(
        name=prepared.plan.name,
        title=prepared.plan.title,
        goal=goal.text,
        goal_unit=goal.unit,
        outcome="incomplete",
        reason="The search has not begun.",
        space=space,
        trials=(),
        started_at=datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
        machine=fleet.description if fleet is not None else describe_machine(),
    )
    trials: tuple[Trial, ...] = ()
    if resume:
        earlier = read_tuning(folder)
        if (earlier.space, earlier.goal) != (space, goal.text):
            raise UsageError(
                f"the search in {folder} was for another space or goal",
                hint="Give the spec and the values that it was started with, or a new --output.",
            )
        trials = earlier.trials
        blank = msgspec.structs.replace(
            blank, started_at=earlier.started_at, duration_s=earlier.duration_s
        )
    elif folder.exists() and any(folder.iterdir()):
        raise FolderTakenError(f"{folder} is not empty", hint="Add --resume, or name a new folder.")
    runs = folder / TRIALS_FOLDER
    with private_files(), contextlib.ExitStack() as opened:
        runs.mkdir(parents=True, exist_ok=True)
        machine: RealMachine
        if fleet is None:
            machine = ThisMachine(selection, runs, goal, progress)
        else:
            journal = opened.enter_context(contextlib.closing(Journal(folder)))
            machine = FleetMachine(selection, runs, goal, fleet, journal, folder, tell)
        follower = _Follower(folder, machine, tell)
        result = Search(blank, machine, settings, listener=follower, trials=trials).run()
        if result.is_proved:
            _write_launch_files(folder, machine, result)
        write_atomically(folder / PAGE_FILE, to_html(result))
    return result


def require_extra() -> None:
    """See that the extra `tune` is installed, before anything is waited for.

    Raises:
        UsageError: a part of it is missing.
    """
    missing = [name for name in ("jinja2", "matplotlib", "optuna") if find_spec(name) is None]
    if missing:
        raise UsageError(
            f"the search needs {quoted_list(missing)}, which this installation does not have",
            hint="Install it: pip install 'r2bspec[tune]'.",
        )


def _write_launch_files(folder: Path, machine: RealMachine, result: TuningResult) -> None:
    """Write what starts the winner without r2bspec."""
    winner = result.winner or Deployment()
    prepared = machine.prepare(winner)
    about = (f"Found by 'r2bspec tune': {winner.text}.", result.reason)
    for name, text in launch_files(prepared.plan, prepared.base_dir, about).items():
        write_atomically(folder / name, text.encode())
