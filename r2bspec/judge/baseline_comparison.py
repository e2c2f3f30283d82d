"""Requirements ``of baseline``: found in a verdict, judged by a given function, and put back.

A single run leaves them undecided (`r2bspec.judge.pipeline`). The caller supplies the baseline:
pairs (`r2bspec.judge.pair_comparison`), or earlier runs: a history gates, a stored run is advisory.

A FAIL by a history is confirmed by a second run before it counts, as one by a single session is
(`r2bspec.judge.confirmation`), but at the full confidence. The second run is compared with the same
history: one whose mean is low by chance, or whose runs are alike by chance, fails both. Of
unchanged graphs exactly on the limit, with histories of m normal runs, both runs fail in (% of
400,000)

    second at    m = 5    m = 10    m = 30
    90 %          1.36      0.92      0.62
    95 %          0.92      0.55      0.34

and the promise is at most 1 %.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Final

import msgspec

from r2bspec.judge.baseline_ratio import (
    BaselineCase,
    StoredValues,
    advise_by_stored_run,
    judge_history,
)
from r2bspec.judge.confirmation import confirm_requirement
from r2bspec.judge.decision_policy import DecisionPolicy, without_own_confidence
from r2bspec.judge.measure.distribution import HISTORY_PARTS
from r2bspec.judge.measure.metric_catalogue import WHOLE_GRAPH, MetricError, MetricInfo, resolve
from r2bspec.judge.measure.metric_values import metric_value
from r2bspec.judge.measure.samples import RunSamples, starts_of
from r2bspec.judge.pipeline import judge, latency_unknown_by_order
from r2bspec.judge.uncertainty_budget import resolution
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.language.spec import Objective
from r2bspec.plan.plan import GRAPH_ROLES, Plan
from r2bspec.record.baseline_file import BaselineRecord
from r2bspec.record.run_folder import Run

JudgeBaseline = Callable[[BaselineCase], RequirementVerdict]
"""The verdict on one requirement of the baseline."""

Objectives = Mapping[str, Objective]

_CONFIRMED = "A second run confirmed the comparison with the history."
_NO_SECOND_RUN = "No second run was made to confirm it."
_NOT_COUNTED = "With 'gate.confirm: false' the second run does not count."
_NOT_CONFIRMED = "A second run did not confirm the comparison with the history."

HISTORY_CONFIRMATION_CONFIDENCE: Final = CONFIDENCE
"""The confidence at which the second run is judged by the same history."""


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
    if info.scope != "search" and one.at_hz is None:
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
    # The first runs of a history do not turn a new project red, unless it asks for that.
    waits = verdict.learning and policy.inconclusive != "fail"
    return msgspec.structs.replace(
        verdict, level="info" if waits else one.level, notes=(*verdict.notes, *one.notes)
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
    iterations = samples.iterations_at(one.at_hz)
    if info.scope == "search" or not iterations:
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
    if info.scope == "search":
        search = samples.record.search
        return [search.holds_hz] if search is not None else []
    if info.scope == "monitor" and monitor not in samples.monitors:
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


_MONITOR_METRICS = (
    "throughput.mean",
    *(f"latency.{part}" for part in HISTORY_PARTS),
    "drop_rate",
)

_REACTION_METRICS = (*(f"reaction.{part}" for part in HISTORY_PARTS), "drop_rate")

PART_FAMILIES: Final = (".callback", ".wait", ".take", ".transport")
"""How the series of the parts of nodes and topics end of which a history has `GROWTH_PARTS`."""

GROWTH_PARTS: Final = ("p50", "mean")
"""The median scatters less on a busy machine; the mean has what happens to some messages alone."""

TrackedMetric = tuple[float | None, str | None, MetricInfo]
"""An offered rate, a monitor, and a metric."""


def tracked_metrics(run: Run, samples: RunSamples) -> Iterator[TrackedMetric]:
    """The metrics of a run that a history stores: the usual ones, and those of its objectives."""
    yield from dict.fromkeys(
        (*_default_metrics(run, samples), *required_metrics(run.plan, samples))
    )


def _default_metrics(run: Run, samples: RunSamples) -> Iterator[TrackedMetric]:
    graph = {
        process_record.name
        for process_record in run.record.processes
        if process_record.role in GRAPH_ROLES
    }
    for rate in samples.iterations:
        for monitor in samples.monitors:
            reacts = samples.iterations[rate][0].monitors[monitor].of_events
            for name in _REACTION_METRICS if reacts else _MONITOR_METRICS:
                yield rate, monitor, resolve(name, samples.monitors)[1]
        for process in sorted(graph | ({WHOLE_GRAPH} if len(graph) > 1 else set())):
            yield rate, None, resolve(f"cpu.{process}.mean", (), samples.subjects)[1]
        for series in samples.iterations[rate][0].anatomy:
            if series.endswith(PART_FAMILIES):
                with contextlib.suppress(MetricError):
                    for part in GROWTH_PARTS:
                        yield rate, None, resolve(f"{series}.{part}", (), samples.subjects)[1]
    if samples.record.search is not None:
        yield None, None, resolve("peak.rate", ())[1]


def required_metrics(plan: Plan, samples: RunSamples) -> Iterator[TrackedMetric]:
    """The metrics of a run that the objectives of a plan name, at their rates."""
    for objective in plan.objectives.values():
        rates = [objective.at.hz] if objective.at is not None else []
        for requirement in objective.require:
            try:
                monitor, info = resolve(requirement.metric, samples.monitors, samples.subjects)
            except MetricError:
                continue
            if info.scope in {"search", "probe", "truth"}:
                continue
            monitors = samples.monitors if info.scope == "monitor" and not monitor else (monitor,)
            yield from ((rate, monitor_name, info) for rate in rates for monitor_name in monitors)


def judge_with_baseline(
    verdict: Verdict,
    objectives: Objectives,
    samples: RunSamples,
    fresh: RunSamples | None,
    policy: DecisionPolicy,
    baseline: BaselineRecord,
) -> Verdict:
    """A verdict whose requirements of the baseline are judged by earlier runs.

    Args:
        verdict: on the run by itself.
        objectives: that were judged.
        samples: the run.
        fresh: the second run that was made because the first fails by the history, if any.
        policy: by which it was judged.
        baseline: the baseline runs.
    """
    compared = compare_with_baseline(verdict, objectives, samples, policy, baseline)
    if not fails_by_history(compared) or not compared.is_judged:
        return compared
    if fresh is None or not policy.confirm:
        return compared.saying(_NO_SECOND_RUN if fresh is None else _NOT_COUNTED)
    own = without_own_confidence(objectives)
    alike = replace(policy, confidence=HISTORY_CONFIRMATION_CONFIDENCE, looks=None)
    again = compare_with_baseline(judge(own, fresh, alike), own, fresh, alike, baseline)
    second = again.by_key
    # What failed without the history has had its own confirmation session.
    requirements = tuple(
        confirm_requirement(requirement, second.get(requirement.key))
        if requirement.method == "prediction interval"
        else requirement
        for requirement in compared.requirements
    )
    confirmed = compared.with_requirements(requirements, policy.inconclusive)
    return confirmed.saying(_CONFIRMED if fails_by_history(confirmed) else _NOT_CONFIRMED)


def compare_with_baseline(
    verdict: Verdict,
    objectives: Objectives,
    samples: RunSamples,
    policy: DecisionPolicy,
    baseline: BaselineRecord,
) -> Verdict:
    """The same without confirmation."""
    return judge_baseline_requirements(
        verdict, objectives, samples, policy, lambda case: _by_earlier_runs(case, samples, baseline)
    )


def fails_by_history(verdict: Verdict) -> bool:
    """Whether a verdict is a FAIL that a second run has to confirm."""
    return any(
        requirement.fails_run and requirement.method == "prediction interval"
        for requirement in verdict.requirements
    )


def _by_earlier_runs(
    case: BaselineCase, samples: RunSamples, baseline: BaselineRecord
) -> RequirementVerdict:
    before = baseline.find(case.at_hz, case.monitor, case.info.name)
    if baseline.kind == "history":
        new = run_value(case.info, case.monitor, case.at_hz, samples)
        return judge_history(case, before.values, new)
    return advise_by_stored_run(
        case,
        StoredValues(before.values, before.starts),
        StoredValues(
            iteration_values(case.info, case.monitor, case.at_hz, samples),
            starts_of(samples.iterations_at(case.at_hz)),
        ),
    )
