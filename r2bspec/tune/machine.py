"""Combinations on real ROS 2: each start is a run with a folder of its own, as `run` plays it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import msgspec

from r2bspec import api
from r2bspec.check.rules.variables_and_tune import goal_problem
from r2bspec.compare.interleaved_comparison import ComparisonSide, prepare_comparison
from r2bspec.compare.interleaved_runs import compare
from r2bspec.diagnostics.quote import time_text
from r2bspec.errors import ExitStatus, R2bspecError, UsageError, without_output
from r2bspec.execute.errors import InterruptedRunError, UnwritableRunError
from r2bspec.execute.states import Progress
from r2bspec.judge.measure.metric_catalogue import MetricError, Subjects, resolve
from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.judge.measure.units import show
from r2bspec.judge.ratio_of_starts import run_value
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.language.comparison_grammar import Requirement, parse_requirement
from r2bspec.language.quantities import Rate
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.language.spec import Objective
from r2bspec.plan.canonical_json import plan_hash
from r2bspec.plan.comparability import single_run_plan
from r2bspec.plan.plan import Plan
from r2bspec.plan.time_estimate import estimate_time
from r2bspec.record.run_folder import open_run
from r2bspec.tune.space import MAX_EXCESS, Combination, Space, assignments, changes_text
from r2bspec.tune.tuning_result import Proof, Start

_ENDING: Final = (InterruptedRunError, UnwritableRunError)
"""Errors that no other combination would not have."""

_NOT_PERMITTED: Final = frozenset({"R2B636", "R2B637"})
"""CPUs, a policy or a niceness that the system does not grant: nothing of the graph was started."""

_COST: Final = "cost of the values"
"""The objective by which pairs are judged, beside those of the spec."""


class TuningError(UsageError):
    """The spec leaves nothing to search for."""

    code = "R2B808"


class Goal(msgspec.Struct, frozen=True, kw_only=True):
    """The metric to minimize.

    Attributes:
        metric: as a requirement names it.
        at: the highest rate that an objective demands; None where the graph or the recording has
            its own.
        unit: the unit of the metric.
    """

    metric: str
    at: Rate | None
    unit: str

    @property
    def text(self) -> str:
        """The metric with its rate."""
        return f"{self.metric} at {self.at}" if self.at is not None else self.metric


def goal_of(plan: Plan, metric: str) -> Goal:
    """Return the goal of a search.

    Raises:
        TuningError: there is no such metric, it cannot be minimized, it belongs to no single
            monitor, or nothing is played at a rate of which it could be measured.
    """
    monitors = [monitor.name for monitor in plan.monitors]
    subjects = Subjects.of_plan(plan)
    problem = goal_problem(metric, monitors, subjects, is_observed=bool(plan.anatomy))
    if problem is not None:
        message, way_out = problem
        raise TuningError(f"{metric} cannot be minimized: {message}", hint=way_out)
    unit = resolve(metric, monitors, subjects)[1].unit
    if plan.playback_mode in {"timeline", "live"}:
        return Goal(metric=metric, at=None, unit=unit)
    played = {play.rate_hz for play in plan.play}
    rates = {
        objective.at
        for objective in plan.objectives.values()
        if objective.level == "error" and objective.at is not None and objective.at.hz in played
    }
    rates = rates or {Rate(hz) for hz in played}
    if not rates:
        raise TuningError(
            "no rate is played at which combinations could be compared",
            hint="Add benchmark.rates: the rate that the graph has to sustain.",
        )
    return Goal(metric=metric, at=max(rates), unit=unit)


@dataclass
class RealMachine:
    """This host, which plays one run at a time; the caller has its lock.

    Attributes:
        selection: the selection of the spec.
        space: the space of the combinations.
        folder: receives the run folders.
        goal: the goal of the search.
        progress: is notified of the progress of each run.
    """

    selection: SpecSelection
    space: Space
    folder: Path
    goal: Goal
    progress: Progress = field(default_factory=Progress)
    _first_with: dict[str, Combination] = field(default_factory=dict, init=False)

    def now(self) -> float:
        """Return the seconds of the monotonic clock."""
        return time.monotonic()

    def prepare(self, combination: Combination) -> api.PreparedBenchmark:
        """Compile a combination.

        Raises:
            InvalidSpecError: the spec has errors with it.
        """
        changes = self.space.changes(combination)
        return api.prepare(self.selection, sets=(*self.selection.sets, *assignments(changes)))

    def start(self, combination: Combination, name: str) -> Start:
        """Implement `Machine`. A start that the machine could not play is repeated once.

        Raises:
            InterruptedRunError: a signal ended the run.
            UnwritableRunError: the run folder cannot be written.
        """
        try:
            prepared = self.prepare(combination)
        except R2bspecError as error:
            return Start(outcome="refused", reason=_reason(error))
        first = self._first_with.setdefault(plan_hash(prepared.plan), combination)
        if first != combination:
            same = changes_text(self.space.changes(first), self.space.values)
            return Start(outcome="refused", reason=f"the plan is that of {same}")
        plan = single_run_plan(prepared.plan)
        start = self._play(replace(prepared, plan=plan), name)
        if start.outcome == "invalid":
            start = self._play(replace(prepared, plan=plan), f"{name}-again")
        return start

    def _play(self, prepared: api.PreparedBenchmark, name: str) -> Start:
        try:
            result = api.run(prepared, self.folder / name, self.progress, wait_s=None)
        except _ENDING:
            raise
        except R2bspecError as error:
            # What is wrong with a spec or not installed is no failure of the graph.
            refused = error.exit_code is ExitStatus.USAGE or error.code in _NOT_PERMITTED
            return Start(outcome="refused" if refused else "broken", reason=_reason(error))
        verdict = result.verdict
        if not verdict.is_judged:
            return Start(outcome="invalid", reason=verdict.reason, run=name)
        try:
            cost = self._cost(name)
        except MetricError as error:
            return Start(outcome="refused", reason=f"{self.goal.metric}: {error}", run=name)
        excess, missed = _furthest_miss(verdict, prepared.plan)
        if cost is None:
            missed = f"{self.goal.text} has no value"
        failed = any(requirement.fails_run for requirement in verdict.requirements)
        passed = all(_is_met(requirement) for requirement in verdict.requirements)
        return Start(
            outcome="fail" if failed else "pass" if passed else "inconclusive",
            cost=cost,
            excess=excess,
            reason=missed,
            run=name,
        )

    def _cost(self, name: str) -> float | None:
        samples = read_samples(open_run(self.folder / name))
        monitor, info = resolve(self.goal.metric, samples.monitors, samples.subjects)
        at_hz = self.goal.at.hz if self.goal.at is not None else next(iter(samples.iterations))
        return run_value(info, monitor, at_hz, samples)

    def prove(
        self, base: Combination | None, winner: Combination, pairs: int, limit_s: float
    ) -> Proof:
        """Implement `Machine`; the errors are those of `start`."""
        name = "proof"
        try:
            if base is None:
                return self._prove_alone(winner, name, limit_s)
            result = self._compare(base, winner, name, pairs, limit_s)
        except _ENDING:
            raise
        except R2bspecError as error:
            return Proof(run=name, reason=f"The proof ended with an error: {_reason(error)}")
        proof = _proof_of(result, name)
        if result.pairs is None or not result.verdict.is_judged:
            return proof
        cost = next(one for one in result.verdict.requirements if one.objective == _COST)
        return msgspec.structs.replace(
            proof,
            gains=cost.outcome == "pass",
            before=cost.compared.base if cost.compared is not None else None,
            after=cost.compared.head if cost.compared is not None else None,
            ratio=cost.estimate,
            lower=cost.lower,
            upper=cost.upper,
            pairs=result.pairs.used,
        )

    def _compare(
        self, base: Combination, head: Combination, name: str, pairs: int, limit_s: float
    ) -> Result:
        sides = []
        for combination in (base, head):
            prepared = self.prepare(combination)
            plan = self._judged_by_cost(_within(prepared.plan, limit_s))
            sides.append(ComparisonSide(plan, prepared.base_dir, prepared.spec_text))
        # A transport is a part of the load, and may be varied.
        comparison = prepare_comparison(*sides, against="today's values", pairs=pairs, force=True)
        return compare(comparison, self.folder / name, self.progress)

    def _judged_by_cost(self, plan: Plan) -> Plan:
        requirement = parse_requirement(f"{self.goal.metric} <= 100 % of baseline")
        cost = Objective(at=self.goal.at, require=(requirement,))
        return msgspec.structs.replace(plan, objectives={**plan.objectives, _COST: cost})

    def _prove_alone(self, winner: Combination, name: str, limit_s: float) -> Proof:
        prepared = self.prepare(winner)
        plan = _within(prepared.plan, limit_s)
        if (takes_s := estimate_time(plan).seconds) > limit_s:
            times = f"{time_text(takes_s)}, and {time_text(limit_s)} are left"
            return Proof(run=name, reason=f"Runs of the winner take {times}: give a larger budget.")
        result = api.run(
            replace(prepared, plan=plan), self.folder / name, self.progress, wait_s=None
        )
        return _proof_of(result, name)


def _proof_of(result: Result, name: str) -> Proof:
    """Return what a result shows of the requirements of the spec."""
    verdict = result.verdict
    if not verdict.is_judged:
        return Proof(run=name, reason=f"Nothing was judged: {verdict.reason}")
    unmet = [
        f"{one.text} ({show(one.estimate, one.unit)})"
        for one in verdict.requirements
        if one.objective != _COST and not _is_met(one)
    ]
    reason = f"It is not shown that the winner meets {', '.join(unmet)}." if unmet else ""
    return Proof(run=name, meets=not unmet, reason=reason)


def _is_met(one: RequirementVerdict) -> bool:
    """Return whether a requirement is met, or does not count."""
    return one.outcome == "pass" or one.level != "error"


def _within(plan: Plan, limit_s: float) -> Plan:
    """Return the plan of a proof, which ends in time, and of which no failure is confirmed."""
    budget_ns = max(1, int(limit_s * 1e9))
    gate = msgspec.structs.replace(plan.gate, confirm=False, time_budget_ns=budget_ns)
    return msgspec.structs.replace(plan, gate=gate)


def _furthest_miss(verdict: Verdict, plan: Plan) -> tuple[float, str]:
    """Return the excess of the requirement that is missed most, and its text if it is missed."""
    written = {
        (name, requirement.text): requirement
        for name, objective in plan.objectives.items()
        for requirement in objective.require
    }
    excesses = [
        (_excess(one, written[one.objective, one.text]), one)
        for one in verdict.requirements
        if one.level == "error" and (one.objective, one.text) in written
    ]
    furthest, one = max(excesses, key=lambda pair: pair[0], default=(0.0, None))
    if one is None or furthest <= 0:
        return furthest, ""
    return furthest, f"{one.text} ({show(one.estimate, one.unit)})"


def _excess(one: RequirementVerdict, requirement: Requirement) -> float:
    """Return by how much a requirement is missed; see `Start`."""
    if one.lost:
        return MAX_EXCESS
    if one.estimate is None or one.limit is None or requirement.op in {None, "==", "!="}:
        return MAX_EXCESS if one.outcome == "fail" else 0.0
    if requirement.op in {"<", "<="}:
        return excess(one.estimate, one.limit)
    return excess(one.limit, one.estimate)


def excess(above: float, below: float) -> float:
    """Return by how much a value that should be below another is above it; see `Start`."""
    if above <= 0 or below <= 0:
        # There is no ratio to nothing: of a share that must be 0 each percent counts as such.
        return min(MAX_EXCESS, above - below)
    return max(-MAX_EXCESS, min(MAX_EXCESS, math.log(above / below)))


def _reason(error: R2bspecError) -> str:
    if isinstance(error, api.InvalidSpecError):
        first = next(found for found in error.diagnostics if found.severity == "error")
        return f"{first.code}: {first.message}"
    return f"{error.code}: {without_output(str(error))}"
