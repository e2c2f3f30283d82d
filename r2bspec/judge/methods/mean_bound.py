"""A bound on a mean, by t over the iterations, and over the starts where there are several.

One value for each iteration: messages within one are correlated, and the difference between
iterations is the noise that a second run would show. A run with several starts of the graph's
processes is a hierarchical sample (`r2bspec.judge.statistics.t_interval`).

A lost output has no latency, and no mean includes it. So a latency whose mean is small enough does
not PASS if more than 1 % of the outputs are lost: the mean describes only the others. Fewer are
stated in a note.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from r2bspec.judge.caveats import correlation_notes, stall_notes
from r2bspec.judge.measure.metric_values import metric_value
from r2bspec.judge.measure.samples import LOSS_SENSITIVE_FAMILIES, SegmentSamples, starts_of
from r2bspec.judge.measure.times import Seconds
from r2bspec.judge.measure.units import show
from r2bspec.judge.requirement_case import MAX_LOST_SHARE, Decision, RequirementCase, undecided
from r2bspec.judge.statistics.autocorrelation import serial_degrees_of_freedom
from r2bspec.judge.statistics.t_interval import HierarchicalInterval, hierarchical_interval
from r2bspec.judge.statistics.variance_components import growth_for_mean
from r2bspec.judge.uncertainty_budget import (
    Costs,
    Observations,
    deciding_addition,
    deciding_text,
    resolution,
    uncertainty_budget,
)
from r2bspec.judge.verdict import Outcome
from r2bspec.record.run_record import RunRecord


def judge_mean(case: RequirementCase, record: RunRecord) -> Decision:
    """Decide a requirement on a mean."""
    values: list[float] = []
    for iteration in case.iterations:
        value = metric_value(case.info, case.monitor, iteration)
        if value is None:
            return _no_value(case, iteration)
        values.append(value)
    if len(values) < 2:
        estimate = values[0] if values else None
        return Decision(
            outcome="inconclusive",
            method="t over iterations",
            reason=f"One iteration ({show(estimate, case.info.unit)}) does not show the "
            "variation between iterations.",
            remedy="At least 2 iterations are needed; 5 or more give a useful interval.",
            estimate=estimate,
            n=len(values),
        )
    step = resolution(case.info, max(values), case.iterations[0].segment.length_s)
    sample = hierarchical_interval(values, starts_of(case.iterations), case.confidence, step)
    interval, shown = sample.interval, _possible(sample, values)
    observed = Observations(values, starts_of(case.iterations), _messages(case))
    outcome = case.outcome_of_bounds(shown.interval.lower, shown.interval.upper)
    decision = Decision(
        outcome=outcome,
        method="t over iterations",
        reason=_reason(case, shown, outcome),
        remedy=_remedy(case, sample, observed, Costs.of(case.iterations, record))
        if outcome == "inconclusive"
        else "",
        estimate=interval.mean,
        lower=shown.interval.lower,
        upper=shown.interval.upper,
        n=len(values),
        effective_n=sample.number / sample.inflation,
        notes=()
        if outcome == "inconclusive"
        else (
            *correlation_notes(sample.pieces, sample.number, sample.inflation),
            *stall_notes(case, interval.lower, interval.upper, outcome),
        ),
        budget=uncertainty_budget(
            case,
            record,
            observed,
            (interval.mean, interval.lower, interval.upper),
            step / math.sqrt(12 * len(values)),
        ),
    )
    return _without_lost(case, decision)


def _possible(sample: HierarchicalInterval, values: Sequence[float]) -> HierarchicalInterval:
    """The interval without what no such mean can be: below 0, where none of its values is.

    It covers the truth as often, as the truth is not in what is left out.
    """
    least = 0.0 if min(values) >= 0 else -math.inf
    interval = replace(sample.interval, lower=max(sample.interval.lower, least))
    return replace(sample, interval=interval)


def _messages(case: RequirementCase) -> list[Seconds]:
    """The messages behind the value of each iteration; nothing where it has none."""
    family = case.info.family
    return [
        monitor_sample.times[family]
        for monitor_sample in case.monitor_samples
        if family in monitor_sample.times
    ]


def _without_lost(case: RequirementCase, decision: Decision) -> Decision:
    """The answer with regard to outputs that were lost, which a mean of latencies leaves out."""
    if case.info.family == "path":
        lost = case.lost_on_paths
        expected = lost + sum(times.size for times in case.observed_times)
    elif case.monitor is not None and case.info.family in LOSS_SENSITIVE_FAMILIES:
        seen = case.monitor_samples
        lost = sum(sample.missed for sample in seen)
        expected = sum(sample.expected for sample in seen)
    else:
        return decision
    if not lost:
        return decision
    share = show(lost / expected, "share")
    left_out = (
        f"{show(lost, 'count')} of {show(expected, 'count')} outputs ({share}), which were lost"
    )
    # What was lost can only have been slow: it does not change a FAIL of an upper limit.
    small = lost <= MAX_LOST_SHARE * expected
    if small or decision.outcome != "pass" or not case.is_upper_bound:
        return replace(decision, notes=(*decision.notes, f"The mean leaves out {left_out}."))
    return replace(
        decision,
        outcome="inconclusive",
        reason=f"The mean leaves out {left_out}, and describes only the others: "
        f"{decision.reason[:1].lower()}{decision.reason[1:]}",
        remedy="State a percentile, in which lost outputs count, or a drop_rate.",
        notes=(),
    )


def _no_value(case: RequirementCase, iteration: SegmentSamples) -> Decision:
    """An iteration without a value: too few outputs fail, too few samples are inconclusive."""
    where = f"iteration {iteration.segment.index}"
    if case.monitor is not None:
        return Decision(
            outcome="fail",
            method="none",
            reason=f"Monitor '{case.monitor}' received too little in {where} for a "
            f"{case.info.name}.",
        )
    return undecided(
        f"{case.info.name} was not sampled in {where}.",
        "Make the iterations longer to get more samples.",
    )


def _reason(case: RequirementCase, found: HierarchicalInterval, outcome: Outcome) -> str:
    unit, interval = case.info.unit, found.interval
    mean = f"The mean of {len(case.iterations)} iterations"
    if found.pieces == "starts":
        mean += f" in {found.number} starts"
    mean += f" is {show(interval.mean, unit)}"
    if found.inflation > 1:
        effective = found.number / found.inflation
        mean += f" (effective sample size {effective:.2g}, as successive ones may be correlated)"
    lower, upper = show(interval.lower, unit), show(interval.upper, unit)
    sure = f"at {case.confidence_text}"
    if outcome == "inconclusive":
        return (
            f"{mean}; {sure} the true mean is {lower} to {upper}, which includes the limit "
            f"{case.limit_text}."
        )
    bound = case.requirement.bound
    limit = f"; the limit is {case.limit_text}" if bound and bound.of_offered else ""
    if (outcome == "pass") == case.is_upper_bound:
        return f"{mean}, {sure} at most {upper}{limit}."
    return f"{mean}, {sure} at least {lower}{limit}."


def _remedy(
    case: RequirementCase, found: HierarchicalInterval, observed: Observations, costs: Costs
) -> str:
    interval = found.interval
    growth = growth_for_mean(
        abs(interval.mean - case.limit),
        (interval.upper - interval.lower) / 2,
        serial_degrees_of_freedom(found.number, found.inflation),
        case.confidence,
    )
    addition = deciding_addition(observed, growth, case.confidence, costs)
    if addition is not None:
        return deciding_text(addition, len(set(observed.starts)))
    return (
        f"The mean is too close to {case.limit_text} for {found.pieces} that differ by "
        f"{show(interval.deviation, case.info.unit)}: change the limit, or use a quieter machine."
    )
