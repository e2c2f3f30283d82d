"""Requirements ``of baseline``: found in a verdict, judged by a given function, and put back.

A single run leaves them undecided (`r2bspec.judge.pipeline`). Interleaved pairs supply the baseline
(`r2bspec.judge.pair_comparison`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping

import msgspec

from r2bspec.judge.baseline_ratio import BaselineCase
from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.measure.metric import MetricInfo, Scope
from r2bspec.judge.measure.metric_catalogue import MetricError, resolve
from r2bspec.judge.measure.metric_values import metric_value
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.methods.mean_bound import resolution
from r2bspec.judge.pipeline import latency_unknown_by_order
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.language.spec import Objective

JudgeBaseline = Callable[[BaselineCase], RequirementVerdict]
"""The verdict on one requirement of the baseline."""


def judge_baseline_requirements(
    verdict: Verdict,
    objectives: Mapping[str, Objective],
    samples: RunSamples,
    policy: DecisionPolicy,
    judge_case: JudgeBaseline,
) -> Verdict:
    """A verdict with its requirements of the baseline judged.

    What has been decided without a baseline stays: a metric that does not exist fails, and a rate
    at which the playback missed its schedule is undecided.

    Args:
        verdict: of the run by itself.
        objectives: that were judged.
        samples: the run.
        policy: by which it was judged.
        judge_case: judges one requirement.
    """
    unusable = {requirement.reason for requirement in verdict.unusable}
    requirements = tuple(
        requirement
        if requirement.reason in unusable
        else _judge_requirement(requirement, objectives, samples, policy, judge_case)
        for requirement in verdict.requirements
    )
    return verdict.with_requirements(requirements, policy.inconclusive)


def _judge_requirement(
    one: RequirementVerdict,
    objectives: Mapping[str, Objective],
    samples: RunSamples,
    policy: DecisionPolicy,
    judge_case: JudgeBaseline,
) -> RequirementVerdict:
    requirement = _baseline_requirement(one, objectives)
    if requirement is None or (one.outcome, one.method) != ("inconclusive", "none"):
        return one
    if (problem := _undecidable_reason(requirement)) is not None:
        reason, remedy = problem
        return msgspec.structs.replace(one, reason=reason, remedy=remedy)
    try:
        _, info = resolve(requirement.metric, samples.monitors, samples.subjects)
    except MetricError:
        return one
    if info.scope is not Scope.SEARCH and one.at_hz is None:
        reason = f"The objective does not state the rate of {info.name}."
        return msgspec.structs.replace(one, reason=reason, remedy="Add 'at' to the objective.")
    iterations = samples.iterations_at(one.at_hz)
    if unknown := latency_unknown_by_order(info, one.monitor, iterations):
        reason, remedy = unknown
        return msgspec.structs.replace(one, reason=reason, remedy=remedy)
    own = objectives[one.objective].confidence
    verdict = judge_case(
        BaselineCase(
            objective=one.objective,
            requirement=requirement,
            at_hz=one.at_hz,
            info=info,
            monitor=one.monitor,
            limit=requirement.bound.value if requirement.bound is not None else math.nan,
            confidence=own.fraction if own is not None else policy.confidence,
            resolution=_resolution(info, one, samples),
        )
    )
    return msgspec.structs.replace(verdict, level=one.level, notes=(*verdict.notes, *one.notes))


def _baseline_requirement(
    one: RequirementVerdict, objectives: Mapping[str, Objective]
) -> Requirement | None:
    """The requirement of the baseline of a verdict; None if it is another requirement."""
    objective = objectives.get(one.objective)
    for requirement in objective.require if objective is not None else ():
        if requirement.text == one.text and requirement.bound is not None:
            return requirement if requirement.bound.of_baseline else None
    return None


def _undecidable_reason(requirement: Requirement) -> tuple[str, str] | None:
    """Why a requirement of the baseline can never be judged, and what to do; or None."""
    if requirement.windows_share is not None:
        reason = "A baseline is compared by whole iterations, not by windows."
        return reason, "Remove 'in ... windows', or use an absolute bound."
    if requirement.op in {"==", "!="}:
        return "No two runs are exactly equal.", "Use <= or >= with a margin, such as 105 %."
    return None


def _resolution(info: MetricInfo, one: RequirementVerdict, samples: RunSamples) -> float:
    """The smallest difference that the clocks can show in a value of one iteration."""
    iterations = samples.iterations_at(one.at_hz)
    if info.scope is Scope.SEARCH or not iterations:
        return 0.0
    values_known = _known(iteration_values(info, one.monitor, one.at_hz, samples))
    return resolution(info, max(values_known, default=0.0), iterations[0].segment.length_s)


def iteration_values(
    info: MetricInfo, monitor: str | None, at_hz: float | None, samples: RunSamples
) -> list[float | None]:
    """A metric in each iteration of a run; None where it is unknown.

    If a monitor received no output in an iteration, none of its metrics has a value there.

    Args:
        info: the metric.
        monitor: for a metric of a monitor.
        at_hz: the offered rate; not used for the peak.
        samples: the run.
    """
    if info.scope is Scope.SEARCH:
        search = samples.record.search
        return [search.holds_hz] if search is not None else []
    if info.scope is Scope.MONITOR and monitor not in samples.monitors:
        return []
    return [
        # Without any output a ratio of drop rates says nothing: both sides would drop everything.
        metric_value(info, monitor, sample)
        if monitor is None or sample.monitors[monitor].answered
        else None
        for sample in samples.iterations_at(at_hz)
    ]


def run_value(
    info: MetricInfo, monitor: str | None, at_hz: float | None, samples: RunSamples
) -> float | None:
    """A metric of a whole run: the mean of its iterations; None if one of them has no value."""
    values = iteration_values(info, monitor, at_hz, samples)
    usable = _known(values)
    return math.fsum(usable) / len(usable) if usable and len(usable) == len(values) else None


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None and math.isfinite(value)]
