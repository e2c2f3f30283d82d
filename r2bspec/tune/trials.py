"""Deployments on real ROS 2: one start of each, and two of them in interleaved pairs.

`RealMachine` says what is played, and what it means; `ThisMachine` plays it here. A trial is one
start of all processes with one iteration at each rate: starts differ by more than what is measured
in one, so they are the unit that a search spends. Where a start is long, a smoke run comes first.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from r2bspec import api
from r2bspec.compare.interleaved_comparison import ComparisonSide, prepare_comparison
from r2bspec.compare.interleaved_runs import compare
from r2bspec.errors import R2bspecError, without_output
from r2bspec.execute.errors import InterruptedRunError, RunError, UnwritableRunError
from r2bspec.execute.progress import Progress
from r2bspec.fleet.errors import FleetError, HostRefusesError
from r2bspec.judge.baseline_comparison import run_value
from r2bspec.judge.measure.metric_catalogue import resolve
from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.judge.measure.units import show
from r2bspec.judge.result import Result
from r2bspec.language.requirement_grammar import parse_requirement
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.language.spec import Objective
from r2bspec.plan.comparability import single_run_plan
from r2bspec.plan.plan import Plan
from r2bspec.plan.smoke_plan import smoke_plan
from r2bspec.plan.time_estimate import estimate_time
from r2bspec.plan.tuning_space import Deployment
from r2bspec.record.run_folder import open_run
from r2bspec.report.anatomy_table import anatomies_of
from r2bspec.tune.machine import Goal, Measurement, Pairs, Start, TuningError, margins_of
from r2bspec.tune.tuning_result import Gain

_SMOKE_FACTOR: Final = 3.0
"""A smoke run comes first where the start would take so many times longer."""

_NOT_PERMITTED: Final = frozenset({"R2B636", "R2B637"})
"""CPUs, a policy or a niceness that the system does not grant: nothing of the graph was started."""

ENDING: Final = (InterruptedRunError, UnwritableRunError)
"""Errors that no other deployment would not have."""

_COST: Final = "cost of the deployment"
"""The objective by which pairs are judged, beside those of the spec."""


class Playing(NamedTuple):
    """A run to be made: a plan with the files of its spec, and where its folder will be.

    Attributes:
        round: as of `Start`.
        anatomy: whether it is observed from inside, too.
    """

    benchmark: api.PreparedBenchmark
    folder: Path
    round: int = 0
    anatomy: bool = False


class Comparing(NamedTuple):
    """Two benchmarks to be played in interleaved pairs, at most so many."""

    base: api.PreparedBenchmark
    head: api.PreparedBenchmark
    against: str
    pairs: int
    folder: Path


@dataclass
class RealMachine(ABC):
    """Deployments of a spec on real ROS 2, wherever runs are made.

    Attributes:
        selection: of the spec.
        folder: receives the run folders.
        goal: the metric that is to be least.
    """

    selection: SpecSelection
    folder: Path
    goal: Goal
    _prepared: dict[Deployment, api.PreparedBenchmark] = field(default_factory=dict, init=False)

    @abstractmethod
    def play(self, runs: Sequence[Playing]) -> Iterable[Result | R2bspecError]:
        """Make runs; each is judged, or has the error that ended it.

        Raises:
            R2bspecError: no run can be made any more.
        """

    @abstractmethod
    def play_pairs(self, comparing: Comparing) -> Result:
        """Make a comparison.

        Raises:
            R2bspecError: it ended with an error.
        """

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
        runs: dict[Start, Playing] = {}
        for start in starts:
            try:
                benchmark = self.prepare(start.deployment)
            except R2bspecError as error:
                found[start] = Measurement(state="refused", reason=_reason(error))
                continue
            plan = single_run_plan(_without_overhead(benchmark.plan))
            runs[start] = Playing(
                replace(benchmark, plan=plan),
                self.folder / start.name,
                start.round,
                anatomy=not start.deployment.choices and not start.round,
            )
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

    def _broken_by_smoke(self, runs: Mapping[Start, Playing]) -> dict[Start, Measurement]:
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

    def _played(self, runs: Mapping[Start, Playing]) -> dict[Start, Measurement]:
        unused = {
            start: run._replace(folder=unused_folder(run.folder)) for start, run in runs.items()
        }
        results = self.play(list(unused.values())) if unused else ()
        return {
            start: self._measured(run, result)
            for (start, run), result in zip(unused.items(), results, strict=True)
        }

    def slowest_part(self, deployment: Deployment, name: str) -> str:
        """See `Machine`; what cannot be observed is unknown."""
        benchmark = self.prepare(deployment)
        plan = single_run_plan(_without_overhead(benchmark.plan))
        folder = unused_folder(self.folder / name)
        (result,) = self.play([Playing(replace(benchmark, plan=plan), folder, anatomy=True)])
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
        self, base: Deployment, head: Deployment, pairs: int, name: str, lever: str = ""
    ) -> Pairs:
        """See `Machine`; the errors are those of `measure`."""
        nothing = Gain(
            change=head.text,
            lever=lever,
            metric=self.goal.text,
            unit=self.goal.unit,
            before=None,
            after=None,
            ratio=None,
            lower=None,
            upper=None,
            pairs=0,
        )
        sides = self._side(base), self._side(head)
        folder = unused_folder(self.folder / name)
        try:
            result = self.play_pairs(Comparing(*sides, base.text, pairs, folder))
        except ENDING:
            raise
        except R2bspecError as error:
            return Pairs(gain=nothing, reason=_reason(error))
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
            reason="" if cost.estimate is not None else cost.reason,
        )

    def prepare(self, deployment: Deployment) -> api.PreparedBenchmark:
        """The plan of a deployment.

        Raises:
            InvalidSpecError: the spec has errors with it.
        """
        if deployment not in self._prepared:
            self._prepared[deployment] = api.prepare(
                self.selection, sets=(*self.selection.sets, *deployment.sets)
            )
        return self._prepared[deployment]

    def _side(self, deployment: Deployment) -> api.PreparedBenchmark:
        """A deployment as one side of pairs, judged by its cost, too."""
        prepared = self.prepare(deployment)
        cost = Objective(
            at=self.goal.at,
            require=(parse_requirement(f"{self.goal.metric} <= 100 % of baseline"),),
        )
        gate = msgspec.structs.replace(prepared.plan.gate, confirm=False, time_budget_ns=0)
        plan = msgspec.structs.replace(
            _without_overhead(prepared.plan),
            gate=gate,
            objectives={**prepared.plan.objectives, _COST: cost},
        )
        return replace(prepared, plan=plan)

    def _measured(self, run: Playing, result: Result | R2bspecError) -> Measurement:
        if isinstance(result, FleetError):
            return Measurement(state="invalid", reason=_reason(result))
        if isinstance(result, R2bspecError):
            refused = isinstance(result, HostRefusesError) or result.code in _NOT_PERMITTED
            return Measurement(state="refused" if refused else "broken", reason=_reason(result))
        folder, plan = run.folder, run.benchmark.plan
        if not result.verdict.is_judged:
            return Measurement(state="invalid", reason=result.verdict.reason, run=folder.name)
        samples = read_samples(open_run(folder))
        monitor, info = resolve(self.goal.metric, samples.monitors, samples.subjects)
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
class ThisMachine(RealMachine):
    """Real ROS 2 on this host; the caller has the lock of the host.

    Attributes:
        progress: is notified of the progress of each run.
    """

    progress: Progress | None = None

    @property
    def width(self) -> int:
        """One: a second one would disturb it."""
        return 1

    def play(self, runs: Sequence[Playing]) -> Iterator[Result | R2bspecError]:
        """See `RealMachine`."""
        for run in runs:
            try:
                yield api.run(
                    run.benchmark, run.folder, self.progress, lock="off", anatomy=run.anatomy
                )
            except ENDING:
                raise
            except (RunError, api.GraphMismatchError) as error:
                yield error

    def play_pairs(self, comparing: Comparing) -> Result:
        """See `RealMachine`."""
        base, head = (
            ComparisonSide(side.plan, side.base_dir, side.spec_text)
            for side in (comparing.base, comparing.head)
        )
        # A transport is a part of the load, and a lever.
        comparison = prepare_comparison(
            base, head, against=comparing.against, pairs=comparing.pairs, force=True
        )
        return compare(comparison, comparing.folder, self.progress)


def _without_overhead(plan: Plan) -> Plan:
    """The plan without the ten seconds for what of a latency is not the graph's."""
    phases = tuple(phase for phase in plan.phases if phase != "harness_overhead")
    return msgspec.structs.replace(plan, phases=phases)


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
