"""Requirements ``of baseline``: found in a verdict, judged by a given function, and put back.

A single run leaves them undecided (`r2bspec.judge.judge_requirement`). The caller supplies the
baseline: pairs, a history, or a stored run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import msgspec

from r2bspec.judge.baseline_ratio import BaselineComparison
from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.judge_requirement import iterations_at, latency_unknown_by_order
from r2bspec.judge.methods.mean_bound import resolution
from r2bspec.judge.outcome import outcome_of
from r2bspec.judge.verdict import EXIT_CODES, RequirementVerdict, Verdict
from r2bspec.language.requirement_grammar import Requirement
from r2bspec.language.spec import Objective
from r2bspec.measure.metric_catalogue import MetricError, MetricInfo, resolve
from r2bspec.measure.metric_values import metric_value
from r2bspec.measure.samples import RunSamples


@dataclass(frozen=True)
class BaselineQuestion:
    """A requirement of the baseline that can be judged, and its metric."""

    comparison: BaselineComparison
    info: MetricInfo


JudgeBaseline = Callable[[BaselineQuestion], RequirementVerdict]
"""The verdict on one requirement of the baseline."""


def judge_baseline_requirements(
    verdict: Verdict,
    objectives: Mapping[str, Objective],
    samples: RunSamples,
    policy: DecisionPolicy,
    answer: JudgeBaseline,
) -> Verdict:
    """A verdict with its requirements of the baseline judged.

    What has been decided without a baseline stays: a metric that does not exist fails, and a rate
    at which the playback missed its schedule is undecided.

    Args:
        verdict: of the run by itself.
        objectives: that were judged.
        samples: the run.
        policy: by which it was judged.
        answer: judges one requirement.
    """
    unusable = {one.reason for one in verdict.unusable}
    requirements = tuple(
        one
        if one.reason in unusable
        else _judge_requirement(one, objectives, samples, policy, answer)
        for one in verdict.requirements
    )
    if verdict.outcome in {"invalid", "incomplete"}:
        return msgspec.structs.replace(verdict, requirements=requirements)
    return with_requirement_verdicts(verdict, requirements, policy)


def with_requirement_verdicts(
    verdict: Verdict, requirements: tuple[RequirementVerdict, ...], policy: DecisionPolicy
) -> Verdict:
    """A verdict on a usable run with other verdicts on its requirements."""
    outcome, reason = outcome_of(requirements, policy.inconclusive, verdict.starts)
    return msgspec.structs.replace(
        verdict,
        outcome=outcome,
        exit_code=EXIT_CODES[outcome],
        reason=reason,
        requirements=requirements,
    )


def _judge_requirement(
    one: RequirementVerdict,
    objectives: Mapping[str, Objective],
    samples: RunSamples,
    policy: DecisionPolicy,
    answer: JudgeBaseline,
) -> RequirementVerdict:
    requirement = _baseline_requirement(one, objectives)
    if requirement is None or (one.outcome, one.method) != ("inconclusive", "none"):
        return one
    if (problem := _undecidable_reason(requirement)) is not None:
        reason, remedy = problem
        return msgspec.structs.replace(one, reason=reason, remedy=remedy)
    try:
        _, info = resolve(requirement.metric, samples.monitors, samples.processes)
    except MetricError:
        return one
    if info.scope != "search" and one.at_hz is None:
        reason = f"The objective does not state the rate of {info.name}."
        return msgspec.structs.replace(one, reason=reason, remedy="Add 'at' to the objective.")
    iterations = iterations_at(samples.iterations, one.at_hz)
    if unknown := latency_unknown_by_order(info, one.monitor, iterations):
        reason, remedy = unknown
        return msgspec.structs.replace(one, reason=reason, remedy=remedy)
    own = objectives[one.objective].confidence
    found = answer(
        BaselineQuestion(
            comparison=BaselineComparison(
                objective=one.objective,
                requirement=requirement,
                at_hz=one.at_hz,
                metric=info.name,
                monitor=one.monitor,
                limit=requirement.bound.value if requirement.bound is not None else math.nan,
                unit=info.unit,
                resolution=_resolution(info, one, samples),
                sampled=info.scope in {"process", "machine"},
                zero_allowed=info.dimension == "share" or info.family == "jitter",
                confidence=own.fraction if own is not None else policy.confidence,
            ),
            info=info,
        )
    )
    # The first runs of a history do not turn a new project red, unless it asks for that.
    waits = found.learning and policy.inconclusive != "fail"
    return msgspec.structs.replace(
        found, level="info" if waits else one.level, notes=(*found.notes, *one.notes)
    )


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
    iterations = iterations_at(samples.iterations, one.at_hz)
    if info.scope == "search" or not iterations:
        return 0.0
    segment = iterations[0].segment
    window_s = max((segment.ended_ns - segment.began_ns) / 1e9, 1e-6)
    found = iteration_values(info, one.monitor, one.at_hz, samples)
    known = [each for each in found if each is not None and math.isfinite(each)]
    return resolution(info, max(known, default=0.0), window_s)


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
    if info.scope == "search":
        search = samples.record.search
        return [search.holds_hz] if search is not None else []
    if info.scope == "monitor" and monitor not in samples.monitors:
        return []
    return [
        # Without any output a ratio of drop rates says nothing: both sides would drop everything.
        metric_value(info, monitor, one)
        if monitor is None or one.monitors[monitor].answered
        else None
        for one in iterations_at(samples.iterations, at_hz)
    ]


def run_value(
    info: MetricInfo, monitor: str | None, at_hz: float | None, samples: RunSamples
) -> float | None:
    """A metric of a whole run: the mean of its iterations; None if one of them has no value."""
    found = iteration_values(info, monitor, at_hz, samples)
    known = [each for each in found if each is not None and math.isfinite(each)]
    return math.fsum(known) / len(known) if known and len(known) == len(found) else None
