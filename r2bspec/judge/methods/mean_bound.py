"""How means are decided: by t over the iterations, and over the starts if there are several.

Each iteration has one value: messages within an iteration are correlated, and the difference
between iterations is the noise that a second run would show. A run with several starts of the
graph's processes is a hierarchical sample (`r2bspec.judge.statistics.t_interval`).

A lost output has no latency, and no mean includes it. So a latency whose mean is small enough does
not PASS if more than 1 % of the outputs are lost: the mean describes only the others. Fewer are
stated in a note.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from r2bspec.judge.measure.metric import MetricInfo
from r2bspec.judge.measure.metric_values import metric_value
from r2bspec.judge.measure.samples import SegmentSamples
from r2bspec.judge.measure.units import show
from r2bspec.judge.requirement_case import (
    MAX_LOST_SHARE,
    Decision,
    RequirementCase,
    undecided,
    unmeasured,
)
from r2bspec.judge.statistics.more_pieces import advice, mean_decides, more_pieces
from r2bspec.judge.statistics.t_interval import HierarchicalInterval, hierarchical_interval
from r2bspec.judge.verdict import Outcome
from r2bspec.record.run_record import RunRecord

_CLOCK_RESOLUTION_S: Final = 1e-6
"""Times are taken by software between system calls: nothing below a microsecond is meaningful."""

_CPU_TICK_S: Final = 0.01
"""Linux accounts processor time in ticks of 10 ms."""

_PAGE_BYTES: Final = 4096.0


def resolution(info: MetricInfo, typical: float, window_s: float) -> float:
    """Return the smallest difference in a value of a metric that the clocks can show.

    Args:
        info: the metric.
        typical: its size.
        window_s: the length of the window in which it was measured.
    """
    window_s = max(window_s, _CLOCK_RESOLUTION_S)
    match info.dimension:
        case "time":
            return _CLOCK_RESOLUTION_S
        case "rate":
            return typical * _CLOCK_RESOLUTION_S / window_s
        case "share":
            return _CPU_TICK_S / window_s
        case "size":
            return _PAGE_BYTES
        case _:
            return 0.0


def judge_mean(case: RequirementCase, record: RunRecord) -> Decision:
    """Decide a requirement on a mean."""
    values: list[float] = []
    for iteration in case.iterations:
        value = metric_value(case.info, case.monitor, iteration)
        if value is None:
            return unmeasured(case, record) or _no_value(case, iteration)
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
    sample = hierarchical_interval(values, case.starts, case.level, step)
    interval, shown = sample.interval, _possible(sample, values)
    outcome = case.outcome_of_bounds(shown.interval.lower, shown.interval.upper)
    decision = Decision(
        outcome=outcome,
        method="t over iterations",
        reason=_reason(case, shown, outcome),
        remedy=_remedy(case, sample) if outcome == "inconclusive" else "",
        estimate=interval.mean,
        lower=shown.interval.lower,
        upper=shown.interval.upper,
        n=len(values),
        effective_n=sample.number,
    )
    return _without_lost(case, decision)


def _possible(sample: HierarchicalInterval, values: Sequence[float]) -> HierarchicalInterval:
    """Return the interval without what no such mean can be: below 0, where none of its values is.

    It covers the truth as often, as the truth is not in what is left out.
    """
    least = 0.0 if min(values) >= 0 else -math.inf
    interval = replace(sample.interval, lower=max(sample.interval.lower, least))
    return replace(sample, interval=interval)


def _without_lost(case: RequirementCase, decision: Decision) -> Decision:
    """The answer with regard to outputs that were lost, which a mean of latencies leaves out."""
    lost = case.lost
    if not lost:
        return decision
    expected = lost + sum(values.size for values in case.message_values)
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


def _remedy(case: RequirementCase, found: HierarchicalInterval) -> str:
    interval, (number, pieces) = found.interval, case.pieces
    half = (interval.upper - interval.lower) / 2
    distance = abs(interval.mean - case.limit)
    more = more_pieces(number, mean_decides(distance, half, number, case.level))
    if more is not None:
        return advice(more, pieces)
    return (
        f"The mean is too close to {case.limit_text} for {found.pieces} that differ by "
        f"{show(interval.deviation, case.info.unit)}: change the limit, or use a quieter machine."
    )
