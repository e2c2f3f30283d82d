"""Deployments on real ROS 2: one start of each, and two of them in interleaved pairs.

`RealMachine` says what is played, and what it means; a `Player` plays it: `ThisHost`, here, or the
hosts of a fleet, of which this package knows nothing. A trial is one
start of all processes with one iteration at each rate: starts differ by more than what is measured
in one, so they are the unit that a search spends. Where a start is long, a smoke run comes first.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Literal, Protocol

import msgspec

from r2bspec import api
from r2bspec.compare.interleaved_comparison import (
    BaseFailsError,
    ComparisonSide,
    prepare_comparison,
)
from r2bspec.compare.interleaved_runs import compare
from r2bspec.diagnostics.quote import time_text
from r2bspec.errors import ExitStatus, R2bspecError, without_output
from r2bspec.execute.errors import InterruptedRunError, RunError, UnwritableRunError
from r2bspec.execute.processes.machine import describe_machine
from r2bspec.execute.progress import Progress
from r2bspec.judge.baseline_comparison import run_value
from r2bspec.judge.measure.metric_catalogue import MetricError, resolve
from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.judge.measure.units import show
from r2bspec.judge.result import Result
from r2bspec.language.comparison_grammar import parse_requirement
from r2bspec.language.quantities import Share
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.language.spec import Objective
from r2bspec.middleware.middleware import selected_rmw
from r2bspec.plan.comparability import single_run_plan
from r2bspec.plan.plan import Plan
from r2bspec.plan.prepared_benchmark import PlannedPairs, PlannedRun
from r2bspec.plan.smoke_plan import smoke_plan
from r2bspec.plan.this_machine import SchedulingFacts
from r2bspec.plan.time_estimate import estimate_time
from r2bspec.plan.tuning_space import Deployment
from r2bspec.record.run_folder import open_run
from r2bspec.report.anatomy_table import anatomies_of
from r2bspec.tune.machine import Goal, Measurement, Pairs, Start, Terms, TuningError, margins_of
from r2bspec.tune.tuning_result import Gain

_SMOKE_FACTOR: Final = 3.0
"""A smoke run comes first where the start would take so many times longer."""

_NOT_PERMITTED: Final = frozenset({"R2B636", "R2B637"})
"""CPUs, a policy or a niceness that the system does not grant: nothing of the graph was started."""

ENDING: Final = (InterruptedRunError, UnwritableRunError)
"""Errors that no other deployment would not have."""

_COST: Final = "cost of the deployment"
"""The objective by which pairs are judged, beside those of the spec."""


class Player(Protocol):
    """Who makes the runs of a search."""

    @property
    def width(self) -> int:
        """How many runs are made at once."""

    @property
    def scheduling(self) -> SchedulingFacts | None:
        """What processes may ask for where the runs are made; None for this machine."""

    @property
    def class_text(self) -> str:
        """What has to be the same for costs to be comparable."""

    @property
    def description(self) -> Mapping[str, object]:
        """What a result says of the machine."""

    def keep_journal(
        self, folder: Path, tell: Callable[[str], None]
    ) -> contextlib.AbstractContextManager[None]:
        """Make runs below a folder, for as long as the context lasts.

        Args:
            folder: of the search.
            tell: is called with a line where something happens to a run.
        """

    def play(self, runs: Sequence[PlannedRun]) -> Iterable[Result | R2bspecError]:
        """Make runs; each is judged, or has the error that ended it.

        Raises:
            R2bspecError: no run can be made any more.
        """

    def play_pairs(self, planned: PlannedPairs) -> Result:
        """Make a comparison.

        Raises:
            R2bspecError: it ended with an error.
        """

    def state_of(self, error: R2bspecError) -> Literal["broken", "refused", "invalid"]:
        """What an error that ended a run says of its deployment; see `Measurement`."""


@dataclass
class RealMachine:
    """Deployments of a spec on real ROS 2, wherever runs are made.

    Attributes:
        selection: of the spec.
        folder: receives the run folders.
        goal: the metric that is to be least.
        player: makes the runs.
    """

    selection: SpecSelection
    folder: Path
    goal: Goal
    player: Player
    _prepared: dict[Deployment, api.PreparedBenchmark] = field(default_factory=dict, init=False)

    @property
    def width(self) -> int:
        """How many deployments are measured at once."""
        return self.player.width

    def now(self) -> float:
        """Seconds of the monotonic clock."""
        return time.monotonic()

    def measure(self, starts: Sequence[Start]) -> list[Measurement]:
        """See `Machine`. A start that the machine could not play is made once more.

        Raises:
            InterruptedRunError: a signal ended the run.
            UnwritableRunError: the run folder cannot be written.
            TuningError: even today's deployment is refused.
        """
        found: dict[Start, Measurement] = {}
        runs: dict[Start, PlannedRun] = {}
        for start in starts:
            anatomy = not start.deployment.choices and not start.round
            try:
                runs[start] = self._single_run(start, anatomy=anatomy)
            except R2bspecError as error:
                found[start] = Measurement(state="refused", reason=_reason(error))
        found |= self._broken_by_smoke(runs)
        found |= self._played({start: run for start, run in runs.items() if start not in found})
        again = {start: runs[start] for start, seen in found.items() if seen.state == "invalid"}
        found |= self._played(again)
        for start, seen in found.items():
            if seen.state == "refused" and not start.deployment.choices:
                raise TuningError(
                    f"the spec is refused as it is: {seen.reason}",
                    hint="'r2bspec run' says more; on a fleet with the same --on and --hosts.",
                )
        return [found[start] for start in starts]

    def _single_run(self, start: Start, *, anatomy: bool) -> PlannedRun:
        benchmark = self.prepare(start.deployment)
        plan = single_run_plan(_without_overhead(benchmark.plan))
        folder = self.folder / start.name
        return PlannedRun(replace(benchmark, plan=plan), folder, start.round, anatomy=anatomy)

    def _broken_by_smoke(self, runs: Mapping[Start, PlannedRun]) -> dict[Start, Measurement]:
        """The deployments that a smoke run shows not to work; it is made where a start is long."""
        smokes = {}
        for start, run in runs.items():
            smoke = smoke_plan(self.prepare(start.deployment).plan)
            if _seconds(run.benchmark.plan) > _SMOKE_FACTOR * _seconds(smoke):
                smokes[start] = run._replace(
                    benchmark=replace(run.benchmark, plan=smoke),
                    folder=run.folder.with_name(f"{run.folder.name}-smoke"),
                    anatomy=False,
                )
        return {
            start: seen
            for start, seen in self._played(smokes).items()
            if seen.state in {"broken", "refused"}
        }

    def _played(self, runs: Mapping[Start, PlannedRun]) -> dict[Start, Measurement]:
        unused = {
            start: run._replace(folder=unused_folder(run.folder)) for start, run in runs.items()
        }
        results = self.player.play(list(unused.values())) if unused else ()
        return {
            start: self._measured(run, result)
            for (start, run), result in zip(unused.items(), results, strict=True)
        }

    def slowest_part(self, deployment: Deployment, name: str) -> str:
        """See `Machine`; what cannot be observed is unknown."""
        run = self._single_run(Start(deployment, name), anatomy=True)
        (result,) = self.player.play([run._replace(folder=unused_folder(run.folder))])
        if isinstance(result, R2bspecError):
            return ""
        paths = [path for anatomy in anatomies_of(result) for path in anatomy.paths if path.parts]
        if not paths:
            return ""
        slowest = max(paths, key=lambda path: path.mean or 0.0)
        part = max(slowest.parts, key=lambda part: part.share)
        whole = show(slowest.mean, "s")
        return f"{part.owner}: {part.name} takes {show(part.mean, 's')} of {whole} in the mean"

    def compare(
        self, base: Deployment, head: Deployment, pairs: int, name: str, terms: Terms
    ) -> Pairs:
        """See `Machine`; where a host is lost, it is made once more. The errors are as above."""
        sides = self._side(base, terms), self._side(head, terms)
        nothing = self._no_gain(head, sides[1].plan, terms)
        result = self._twice_if_lost(
            lambda folder: self.player.play_pairs(PlannedPairs(*sides, base.text, pairs, folder)),
            name,
        )
        if isinstance(result, R2bspecError):
            return self._nothing_judged(nothing, result)
        if not result.verdict.is_judged or result.pairs is None:
            return Pairs(gain=nothing, reason=result.verdict.reason)
        cost = next(one for one in result.verdict.requirements if one.objective == _COST)
        seen = cost.compared
        gain = msgspec.structs.replace(
            nothing,
            before=seen.base if seen is not None else None,
            after=seen.head if seen is not None else None,
            unit=seen.unit if seen is not None else self.goal.unit,
            ratio=cost.estimate,
            lower=cost.lower,
            upper=cost.upper,
            pairs=result.pairs.used,
            confidence=cost.confidence,
        )
        objectives = {
            name: objective for name, objective in sides[1].plan.objectives.items() if name != _COST
        }
        return Pairs(
            gain=gain,
            costs_more=cost.outcome == "fail",
            margins=margins_of(result.verdict.requirements, objectives),
            no_ratio="" if cost.estimate is not None else cost.reason,
        )

    def judge(self, deployment: Deployment, name: str, terms: Terms) -> Pairs:
        """See `Machine`; the errors are those of `compare`."""
        benchmark = self.prepare(deployment)
        plan = _by_terms(benchmark.plan, terms)
        nothing = self._no_gain(deployment, plan, terms)
        if (takes_s := _seconds(plan)) > terms.limit_s:
            left = (
                f"{time_text(takes_s)}, and {time_text(terms.limit_s)} are left: give more --budget"
            )
            return Pairs(gain=nothing, reason=f"its runs take {left}", may_retry=True)

        def play(folder: Path) -> Result:
            (result,) = self.player.play([PlannedRun(replace(benchmark, plan=plan), folder)])
            if isinstance(result, R2bspecError):
                raise result
            return result

        result = self._twice_if_lost(play, name)
        if isinstance(result, R2bspecError):
            return self._nothing_judged(nothing, result)
        if not result.verdict.is_judged:
            return Pairs(gain=nothing, reason=result.verdict.reason)
        return Pairs(
            gain=nothing,
            margins=margins_of(result.verdict.requirements, plan.objectives),
            no_ratio="there is nothing to compare with",
        )

    def _twice_if_lost(self, play: Callable[[Path], Result], name: str) -> Result | R2bspecError:
        """A result, or the error that ended it; what ends with a lost host is tried once more."""
        for _ in range(2):
            try:
                return play(unused_folder(self.folder / name))
            except ENDING:
                raise
            except R2bspecError as error:
                ended = error
            if self.player.state_of(ended) != "invalid":
                break
        return ended

    def _nothing_judged(self, gain: Gain, error: R2bspecError) -> Pairs:
        return Pairs(
            gain=gain,
            reason=_reason(error),
            base_fails=error.code == BaseFailsError.code,
            may_retry=self.player.state_of(error) == "invalid",
        )

    def _no_gain(self, head: Deployment, plan: Plan, terms: Terms) -> Gain:
        return Gain(
            change=head.text,
            lever=terms.lever,
            metric=self.goal.text,
            unit=self.goal.unit,
            confidence=plan.gate.confidence,
        )

    def prepare(self, deployment: Deployment) -> api.PreparedBenchmark:
        """The plan of a deployment.

        Raises:
            InvalidSpecError: the spec has errors with it.
        """
        if deployment not in self._prepared:
            self._prepared[deployment] = self.compile(deployment)
        return self._prepared[deployment]

    def compile(self, deployment: Deployment) -> api.PreparedBenchmark:
        """A deployment by the spec as it is now; it is not kept, as it may not be used.

        Raises:
            InvalidSpecError: the spec has errors with it.
        """
        return api.prepare(self.selection, sets=(*self.selection.sets, *deployment.sets))

    def _side(self, deployment: Deployment, terms: Terms) -> api.PreparedBenchmark:
        """A deployment as one side of pairs, judged by its cost, too."""
        prepared = self.prepare(deployment)
        cost = Objective(
            at=self.goal.at,
            require=(parse_requirement(f"{self.goal.metric} <= 100 % of baseline"),),
        )
        plan = _by_terms(prepared.plan, terms)
        plan = msgspec.structs.replace(plan, objectives={**plan.objectives, _COST: cost})
        return replace(prepared, plan=plan)

    def _measured(self, run: PlannedRun, result: Result | R2bspecError) -> Measurement:
        if isinstance(result, R2bspecError):
            state = self.player.state_of(result)
            # What is wrong with a spec or not installed, no other deployment cures.
            if state == "broken" and (
                result.exit_code is ExitStatus.USAGE or result.code in _NOT_PERMITTED
            ):
                state = "refused"
            return Measurement(state=state, reason=_reason(result))
        folder, plan = run.folder, run.benchmark.plan
        if not result.verdict.is_judged:
            return Measurement(state="invalid", reason=result.verdict.reason, run=folder.name)
        samples = read_samples(open_run(folder))
        try:
            monitor, info = resolve(self.goal.metric, samples.monitors, samples.subjects)
        except MetricError as error:
            return Measurement(state="refused", reason=f"{self.goal.metric}: {error}")
        at_hz = self.goal.at.hz if self.goal.at is not None else next(iter(samples.iterations))
        margins = margins_of(result.verdict.requirements, plan.objectives)
        worst = max(margins, key=lambda margin: margin.excess, default=None)
        return Measurement(
            state="played",
            cost=run_value(info, monitor, at_hz, samples),
            margins=margins,
            reason=worst.text if worst is not None and worst.excess > 0 else "",
            run=folder.name,
        )


@dataclass
class ThisHost:
    """This host plays, one run at a time: a second one would disturb it. The caller has its lock.

    Attributes:
        progress: is notified of the progress of each run.
    """

    progress: Progress | None = None
    width = 1
    scheduling = None

    @property
    def class_text(self) -> str:
        """See `Player`."""
        machine = describe_machine()
        known = (machine["architecture"], machine["cpu"], f"{machine['cores']} CPUs")
        return ", ".join(filter(None, (*known, selected_rmw(os.environ))))

    @property
    def description(self) -> Mapping[str, object]:
        """See `Player`."""
        return describe_machine()

    def keep_journal(
        self,
        folder: Path,  # noqa: ARG002
        tell: Callable[[str], None],  # noqa: ARG002
    ) -> contextlib.AbstractContextManager[None]:
        """See `Player`; the run folders say it all."""
        return contextlib.nullcontext()

    def play(self, runs: Sequence[PlannedRun]) -> Iterator[Result | R2bspecError]:
        """See `Player`."""
        for run in runs:
            try:
                yield api.run(
                    run.benchmark, run.folder, self.progress, lock="off", anatomy=run.anatomy
                )
            except ENDING:
                raise
            except (RunError, api.GraphMismatchError) as error:
                yield error

    def play_pairs(self, planned: PlannedPairs) -> Result:
        """See `Player`."""
        base, head = (
            ComparisonSide(side.plan, side.base_dir, side.spec_text)
            for side in (planned.base, planned.head)
        )
        # A transport is a part of the load, and a lever.
        comparison = prepare_comparison(
            base, head, against=planned.against, pairs=planned.pairs, force=True
        )
        return compare(comparison, planned.folder, self.progress)

    def state_of(self, error: R2bspecError) -> Literal["broken"]:  # noqa: ARG002
        """See `Player`."""
        return "broken"


def _without_overhead(plan: Plan) -> Plan:
    """The plan without the ten seconds for what of a latency is not the graph's."""
    phases = tuple(phase for phase in plan.phases if phase != "harness_overhead")
    return msgspec.structs.replace(plan, phases=phases)


def _by_terms(plan: Plan, terms: Terms) -> Plan:
    """The plan judged with the confidence, and ended by the time, that a comparison has."""

    def surer(confidence: float) -> float:
        return 1 - (1 - confidence) * terms.error_share

    gate = msgspec.structs.replace(
        plan.gate,
        confirm=False,
        time_budget_ns=max(1, int(terms.limit_s * 1e9)),
        confidence=surer(plan.gate.confidence),
    )
    objectives = {
        name: objective
        if objective.confidence is None
        else msgspec.structs.replace(
            objective, confidence=Share(surer(objective.confidence.fraction))
        )
        for name, objective in plan.objectives.items()
    }
    return msgspec.structs.replace(_without_overhead(plan), gate=gate, objectives=objectives)


def unused_folder(folder: Path) -> Path:
    """The path, or one with a number after it: a search that was interrupted has left folders."""
    names = (folder, *(folder.with_name(f"{folder.name}-{number}") for number in range(2, 1000)))
    return next(path for path in names if not path.exists())


def _seconds(plan: Plan) -> float:
    return estimate_time(plan).seconds


def _reason(error: R2bspecError) -> str:
    if isinstance(error, api.InvalidSpecError):
        first = next(found for found in error.diagnostics if found.severity == "error")
        return f"{first.code}: {first.message}"
    return f"{error.code}: {without_output(str(error))}"
