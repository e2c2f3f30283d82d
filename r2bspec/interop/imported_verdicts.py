"""Judges a report of ros2_benchmark by the objectives of a spec.

A report has one value for each metric and rate: the mean over the iterations, after the best
and the worst of them were dropped. It proves less than a run of r2bspec:

    metric                       what a report can show
    mean (throughput, latency)   an observation: one value with unknown variation, compared as it is
    maximum, minimum             that the limit was broken; not that it was met, because the worst
                                 iteration is not included
    counts (missed)              likewise
    drop_rate                    the exact binomial test on one iteration's messages
    peak.rate                    that the peak is too low; not that it is high enough, because
                                 that search accepts rates at which a backlog grows
    percentiles, sustained       nothing

What a report cannot show is inconclusive, with a hint what would decide it.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Final, Literal

import msgspec

from r2bspec.interop.ros2_benchmark import MonitorFigures, ReferenceReport
from r2bspec.judge.measure.metric_catalogue import MetricError, MetricInfo, resolve
from r2bspec.judge.measure.units import show
from r2bspec.judge.methods.share_bounds import share_test
from r2bspec.judge.requirement_case import (
    Decision,
    RequirementCase,
    limit_of,
    requirement_verdict,
    undecided,
)
from r2bspec.judge.statistics.effective_sample_size import EffectiveSample
from r2bspec.judge.verdict import EXIT_CODES, RequirementVerdict, Verdict, outcome_of
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.language.spec import Objective
from r2bspec.plan.plan import GatePlan

_Extreme = Literal["", "largest", "smallest"]

_FIGURES: Final[dict[str, tuple[str, _Extreme]]] = {
    "throughput.mean": ("throughput_hz", ""),
    "playback.rate": ("playback_hz", ""),
    "latency.mean": ("latency_mean", ""),
    "latency.min": ("latency_min", "smallest"),
    "latency.max": ("latency_max", "largest"),
    "jitter.mean": ("jitter_mean", ""),
    "jitter.min": ("jitter_min", "smallest"),
    "jitter.max": ("jitter_max", "largest"),
    "sent": ("sent", ""),
    "missed": ("missed", "largest"),
}
"""The value of each metric, and for extremes which one the report excludes."""

_REMEDY = "Run the benchmark with r2bspec, which records every message of every iteration."
_SINGLE_VALUE_NOTE = (
    "A single value without its variation: an observation, not a prediction of the next run."
)
_BURSTS_UNKNOWN_NOTE = (
    "The report does not state whether losses come in bursts; they are taken as independent."
)


def judge_report(
    report: ReferenceReport, objectives: Mapping[str, Objective], gate: GatePlan | None = None
) -> Verdict:
    """Judge a report of the reference tool.

    Args:
        report: as `r2bspec.interop.ros2_benchmark.read_report` returns it.
        objectives: of a spec, by name. If the report has one monitor, requirements on any
            monitor of the spec apply to that one: the report may lack its name.
        gate: of that spec. A report knows neither other load on the machine nor a second run, so
            that only confidence and the effect of an inconclusive verdict count.

    Returns:
        A verdict like that of a run; a pure function of its arguments.
    """
    gate = gate or GatePlan()
    requirements = tuple(
        msgspec.structs.replace(verdict, level=objective.level)
        for name, objective in objectives.items()
        if objective.level != "off"
        for requirement in objective.require
        for verdict in _judge_requirement(report, name, objective, requirement, gate.confidence)
    )
    outcome, reason = outcome_of(requirements, gate.inconclusive)
    return Verdict(
        outcome=outcome,
        exit_code=EXIT_CODES[outcome],
        reason=reason,
        requirements=requirements,
        unusable=(),
    )


def _judge_requirement(
    report: ReferenceReport,
    name: str,
    objective: Objective,
    requirement: Requirement,
    gate_confidence: float,
) -> Iterator[RequirementVerdict]:
    """The verdicts on one requirement: one, or one for each monitor of the report."""
    peak_hz = report.peak_hz if objective.at_peak else None
    at_hz = objective.at.hz if objective.at is not None else peak_hz
    figures = _figures_at(report, at_hz, at_peak=objective.at_peak)
    named_monitor, info = _resolve_metric(requirement, figures)
    confidence = objective.confidence.fraction if objective.confidence else gate_confidence
    monitors: list[str | None] = [*figures] if info.scope == "monitor" else []
    if named_monitor is not None:
        monitors = [named_monitor] if named_monitor in figures or len(figures) != 1 else [*figures]
    for monitor in monitors or [None]:
        case = RequirementCase(
            objective=name,
            requirement=requirement,
            at_hz=at_hz,
            info=info,
            monitor=monitor or None,
            limit=limit_of(requirement, at_hz, info),
            confidence=confidence,
        )
        # The playback is the same for all monitors.
        figure = next(iter(figures.values()), None) if monitor is None else figures.get(monitor)
        decision = _decision(case, report, figure)
        notes: tuple[str, ...] = ()
        if decision.method == "exact binomial":
            notes = (_BURSTS_UNKNOWN_NOTE,)
        elif decision.method == "observation" and decision.outcome == "pass":
            notes = (_SINGLE_VALUE_NOTE,)
        yield msgspec.structs.replace(requirement_verdict(case, decision), notes=notes)


def _resolve_metric(
    requirement: Requirement, figures: Mapping[str, MonitorFigures]
) -> tuple[str | None, MetricInfo]:
    """The monitor and the metric of a requirement."""
    with contextlib.suppress(MetricError):
        return resolve(requirement.metric, figures)
    first, _, rest = requirement.metric.partition(".")
    with contextlib.suppress(MetricError):
        return first, resolve(rest, ())[1]
    return None, MetricInfo(requirement.metric, "probe", "none", "", "observation", "")


def _figures_at(
    report: ReferenceReport, at_hz: float | None, *, at_peak: bool
) -> Mapping[str, MonitorFigures]:
    if at_peak:
        return report.peak
    if at_hz is None:
        return {}
    rates = report.rates.items()
    return next((figures for rate, figures in rates if math.isclose(float(rate), at_hz)), {})


def _decision(
    case: RequirementCase, report: ReferenceReport, figures: MonitorFigures | None
) -> Decision:
    requirement, info = case.requirement, case.info
    if info.statistic == "search":
        return _judge_peak(case, report.peak_hz)
    if requirement.bound is None:
        return _inconclusive(f"The report has no {requirement.metric}.")
    if info.quantile is not None or requirement.windows_share is not None:
        return _inconclusive("The report has summaries only, not single messages.")
    if math.isnan(case.limit):
        return _inconclusive("A report is not compared with a baseline.")
    if figures is None:
        where = f" at {show(case.at_hz, 'Hz')}" if case.at_hz is not None else ""
        return _inconclusive(f"The report has no values{where}.")
    if info.name == "drop_rate":
        return _judge_drop_rate(case, figures)
    if info.scope == "machine":
        return _inconclusive("The report measures shares of all cores, but not their number.")
    field, extreme = _FIGURES.get(info.name, ("", ""))
    value = getattr(figures, field, None) if field else None
    if value is None:
        return _inconclusive(f"The report has no {info.name}.")
    return _judge_observation(case, value, extreme)


def _judge_observation(case: RequirementCase, value: float, extreme: _Extreme) -> Decision:
    """Compare a value with the limit, as far as it shows anything."""
    lost = extreme == ("largest" if case.is_upper_bound else "smallest")
    equal = case.requirement.op in {"==", "!="} and bool(extreme)
    source = f"The report has {show(value, case.info.unit)}"
    doubt = "but excludes the worst iteration" if lost or equal else ""
    return _observed(case, value, source, doubt if case.is_met(value) else "")


def _observed(case: RequirementCase, value: float, source: str, doubt: str) -> Decision:
    """What a value shows by itself: whether the limit is met, unless there is a doubt."""
    if doubt:
        return replace(_inconclusive(f"{source}, {doubt}."), estimate=value)
    return Decision(
        outcome="pass" if case.is_met(value) else "fail",
        method="observation",
        reason=f"{source}; the limit is {case.limit_text}.",
        estimate=value,
        n=1,
    )


def _judge_drop_rate(case: RequirementCase, figures: MonitorFigures) -> Decision:
    """The binomial test on the messages of one iteration, which the values refer to."""
    if figures.sent is None or figures.missed is None or figures.sent < 1:
        return _inconclusive("The report has no message counts.")
    sent, missed = round(figures.sent), math.ceil(figures.missed)
    counts = EffectiveSample(n=sent, bad=missed, bursts=missed, inflation=1.0, cause="")
    test = share_test(counts, case.limit, case.confidence, lost=missed, ceiling=case.is_upper_bound)
    outcome = case.outcome_of_bounds(test.lower, test.upper)
    return Decision(
        outcome=outcome,
        method="exact binomial",
        reason=f"{missed} of {sent} messages were missed; at {case.confidence_text} the true "
        f"share is {show(test.lower, 'share')} to {show(test.upper, 'share')}, and the limit is "
        f"{case.limit_text}.",
        remedy=_REMEDY if outcome == "inconclusive" else "",
        estimate=test.share,
        lower=test.lower,
        upper=test.upper,
        n=sent,
        over=missed,
        share=test,
    )


def _judge_peak(case: RequirementCase, peak_hz: float | None) -> Decision:
    if peak_hz is None:
        return _inconclusive("The report has no peak.")
    # That search overestimates: a value below the limit is a proof.
    is_proof = case.is_met(peak_hz) == case.is_upper_bound
    doubt = "" if is_proof else "but it accepts rates that the graph does not sustain"
    source = f"The search of the report found {show(peak_hz, 'Hz')}"
    return _observed(case, peak_hz, source, doubt)


def _inconclusive(reason: str) -> Decision:
    return undecided(reason, _REMEDY)
