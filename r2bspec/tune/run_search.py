"""A search for a deployment of a spec on this machine, stored in a folder as it goes."""

from __future__ import annotations

import dataclasses
import datetime
from collections.abc import Callable, Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from r2bspec import api
from r2bspec.diagnostics.quote import quoted_list
from r2bspec.errors import R2bspecError, UsageError
from r2bspec.execute.identity.identify_graph import graph_identity
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.plan.canonical_json import plan_hash
from r2bspec.plan.plan import Plan
from r2bspec.plan.tuning_space import Deployment, assignment
from r2bspec.record.files import FolderTakenError, write_atomically
from r2bspec.record.graph_identity import GraphIdentity, identity_differences
from r2bspec.record.run_folder import open_run
from r2bspec.safe_io.private_files import private_files
from r2bspec.tune.launch_file import LAUNCH_FILE, NODES_FILE, launch_files
from r2bspec.tune.machine import TuningError, goal_of
from r2bspec.tune.predict import Predictor
from r2bspec.tune.search import (
    Forecast,
    Predict,
    Search,
    SearchListener,
    SearchSettings,
    know_nothing,
)
from r2bspec.tune.trials import Player, RealMachine
from r2bspec.tune.tuning_page import to_html
from r2bspec.tune.tuning_result import Trial, TuningResult, read_tuning, write_tuning

TRIALS_FOLDER: Final = "trials"
PAGE_FILE: Final = "tuning.html"
PATCH_FILE: Final = "deployment.patch"


class _Follower(SearchListener):
    """Stores what was found after each trial, passes lines on, and predicts by today's run."""

    def __init__(self, folder: Path, machine: RealMachine, tell: Callable[[str], None]) -> None:
        self._folder, self._machine, self._tell = folder, machine, tell

    def found(self, result: TuningResult) -> None:
        """Write the result.

        Raises:
            TuningError: the spec or the code of a node has changed since the search began: both
                are read for each deployment, so this one may be of another graph than those before.
        """
        if change := self._change(result):
            raise TuningError(
                f"{change} while the search was running",
                hint=f"Undo the change, and go on with --output {self._folder} --resume; or search "
                "in a new folder.",
            )
        write_tuning(self._folder, result)

    def _change(self, result: TuningResult) -> str:
        """What is not as it was when the search began; empty if nothing."""
        try:
            now = self._machine.compile(Deployment())
        except R2bspecError as error:
            return f"{self._machine.selection.spec} has changed ({error})"
        if plan_hash(now.plan) != result.plan:
            return f"{self._machine.selection.spec} has changed"
        return _code_change(result.identity, graph_identity(now.plan, now.base_dir))

    def line(self, text: str) -> None:
        """Pass the line on."""
        self._tell(text)

    def predictor(self, today: Trial) -> Predict:
        """A model of the graph from the anatomy of today's run, if there is one."""
        if not today.run:
            return know_nothing
        unknown: set[str] = set()
        try:
            predictor = Predictor(open_run(self._machine.folder / today.run))
        except R2bspecError as error:
            self._tell(f"no predictions: {error}")
            return know_nothing

        @cache
        def predict(deployment: Deployment) -> Forecast:
            try:
                found = predictor.predict(self._machine.compile(deployment).plan)
            except R2bspecError:
                return Forecast()
            if found.reason:
                if found.reason not in unknown:
                    unknown.add(found.reason)
                    self._tell(f"no prediction for {deployment.text}: {found.reason}")
                return Forecast()
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
    player: Player,
    tell: Callable[[str], None] = lambda _: None,
    resume: bool = False,
) -> TuningResult:
    """Search for the deployment that meets the objectives of a spec at the least cost.

    The caller has seen that the extra is there (`require_extra`), and has the lock of the host if
    it makes the runs.

    Args:
        selection: of the spec.
        prepared: from it.
        folder: receives the result and all runs; new or empty, unless a search is resumed.
        settings: how long the search may take.
        minimize: the metric that is to be least.
        player: makes the runs.
        tell: is called with a line after each trial.
        resume: go on with the search whose trials the folder has.

    Raises:
        TuningError: the spec has no objective, or nothing that can be deployed in another way.
        FolderTakenError: the folder has files, and no search is resumed.
        InterruptedRunError: a signal ended a run; the search can be resumed.
    """
    goal = goal_of(prepared.plan, minimize)
    declared = prepared.loaded.spec.tune if prepared.loaded and prepared.loaded.spec else None
    if declared is not None and minimize != declared.minimize:
        # The space has no deployment without what the goal is of.
        sets = (*selection.sets, assignment(("tune", "minimize"), minimize))
        selection = dataclasses.replace(selection, sets=sets)
        prepared = api.prepare(selection)
    space = api.tuning_space(prepared, selection, facts=player.scheduling)
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
        machine=dict(player.description),
        plan=plan_hash(prepared.plan),
        identity=graph_identity(prepared.plan, prepared.base_dir),
        machine_class=player.class_text,
        notes=tuple(_not_judged(prepared.plan)),
    )
    earlier = None
    if resume:
        earlier = read_tuning(folder)
        _check_same(blank, earlier, folder)
    elif folder.exists() and any(folder.iterdir()):
        raise FolderTakenError(f"{folder} is not empty", hint="Add --resume, or name a new folder.")
    runs = folder / TRIALS_FOLDER
    with private_files():
        runs.mkdir(parents=True, exist_ok=True)
        machine = RealMachine(selection, runs, goal, player)
        if earlier is not None and _is_ended(earlier, settings):
            tell("the search has ended: more --trials, --pairs or --budget go on with it")
            result = earlier
        else:
            follower = _Follower(folder, machine, tell)
            with player.keep_journal(folder, tell):
                result = Search(blank, machine, settings, listener=follower, earlier=earlier).run()
        if result.is_proved:
            _write_launch_files(folder, machine, result)
        else:
            for name in (PATCH_FILE, LAUNCH_FILE, NODES_FILE):
                (folder / name).unlink(missing_ok=True)
        write_atomically(folder / PAGE_FILE, to_html(result))
    return result


def _not_judged(plan: Plan) -> Iterator[str]:
    """The requirements that no trial and no pair is judged by."""
    for name, objective in plan.objectives.items():
        for each in objective.require:
            if objective.level == "error" and each.of_baseline:
                yield f"{name}: {each.text} is not judged: a search has no baseline."


def _check_same(now: TuningResult, earlier: TuningResult, folder: Path) -> None:
    """See that the trials of an earlier call say something of what is searched now.

    Raises:
        UsageError: they do not.
    """
    # Another machine, and another graph, have another space, too.
    if earlier.machine_class != now.machine_class:
        what = f"another machine: {earlier.machine_class}; this is {now.machine_class}"
    elif earlier.plan != now.plan:
        what = "another load, graph or objectives: the spec or a file that it names has changed"
    elif (earlier.space, earlier.goal) != (now.space, now.goal):
        what = "another space or goal"
    elif change := _code_change(earlier.identity, now.identity):
        what = f"other code: {change} since then"
    else:
        return
    patch = folder / PATCH_FILE
    undo = f" 'git apply -R {patch}' undoes what --write has changed." if patch.exists() else ""
    raise UsageError(
        f"the search in {folder} was for {what}",
        hint=f"Give the spec and the values that it was started with, or a new --output.{undo}",
    )


def _code_change(before: GraphIdentity | None, now: GraphIdentity | None) -> str:
    """Which code of the graph differs, such as ``blur.py changed``; empty if none does."""
    return ", ".join(identity_differences(before, now)) if before and now else ""


def _is_ended(earlier: TuningResult, settings: SearchSettings) -> bool:
    """Whether a search has decided, and no limit of it is raised."""
    limits = (settings.trials, settings.budget_s, settings.pairs)
    before = (earlier.max_trials, earlier.budget_s, earlier.max_pairs)
    is_raised = any(limit > old for limit, old in zip(limits, before, strict=True))
    return earlier.outcome != "incomplete" and not is_raised


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
