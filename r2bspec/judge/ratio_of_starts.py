"""``of baseline``: a requirement on the ratio of a metric to its value before a change.

A single run leaves it undecided (`r2bspec.judge.pipeline`); pairs of base and head decide it. Each
pair has one ratio of head to base for a metric:

    pairs of runs                       the ratio of the values of both runs
    by turns, p50 of work or latency    the median of the ratios of neighbouring steps
    by turns, mean, up to p95           the ratio of the values of both sides over the same turns

Neighbouring steps are milliseconds apart and see the same machine, so that its changes of speed are
in both of them. Cores of a shared machine differ in speed, too, by up to 2, and a process mostly
stays on its core. So turns for work are played with both graphs on the same core, another one in
the next start: work does not depend on how many cores there are, and times of messages do.

Tails above p95, drops and the peak need more messages than turns have: they are judged on the sides
played alone.

The limit is the margin, as a ratio: ``>= 97 % of baseline`` is 0.97. With the one-sided bounds on
the true ratio, a lower limit passes if the lower bound is at or over it and fails if the upper
bound is below it; an upper limit the other way round. The bounds of pairs are those of t on the
logarithms (`r2bspec.judge.statistics.t_interval`). About one start of both sides by turns in 25 on
a shared machine deviates by 10 to 20 %, so that from six such starts on the smallest and the
largest logarithm are left out. With x the sorted logarithms of n starts, h = n - 2, the trimmed
mean m of the h in the middle, and s the deviation of all n after the smallest and the largest were
set to their neighbours (Winsorised), the bounds are

    m ± t(h - 1) s sqrt((n - 1) / (h (h - 1)))

(Yuen, "The two-sample trimmed t for unequal population variances", Biometrika 61, 1974.)

A metric without a value in one of the pairs (nothing arrived, a percentile that falls on a lost
message) is not left out: it fails for the head, and decides nothing for the base. A metric that was
not sampled decides nothing for either, and neither does a share of 0, which has no ratio.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import msgspec
import numpy as np

from r2bspec.judge.measure.metric import MetricInfo, Scope
from r2bspec.judge.measure.metric_catalogue import WHOLE_GRAPH
from r2bspec.judge.measure.metric_values import metric_value, values_with_lost
from r2bspec.judge.measure.samples import RunSamples, SegmentSamples
from r2bspec.judge.measure.times import Seconds
from r2bspec.judge.measure.units import show
from r2bspec.judge.methods import Method
from r2bspec.judge.methods.mean_bound import resolution
from r2bspec.judge.requirement_case import (
    Decision,
    RequirementCase,
    finite,
    requirement_verdict,
    undecided,
)
from r2bspec.judge.statistics.more_pieces import advice, mean_decides, more_pieces
from r2bspec.judge.statistics.t_interval import (
    MeanInterval,
    RatioInterval,
    mean_interval,
    paired_ratio,
    t_quantile,
)
from r2bspec.judge.verdict import BaselineEstimate, RequirementVerdict
from r2bspec.record.run_record import TurnKind

Values = Sequence[float | None]
"""A metric in the pairs, of one side; None or infinite where it has no value."""


def _undecidable(case: RequirementCase) -> Decision | None:
    """Return why pairs can never decide a requirement, and what to do; None if they can."""
    if case.is_equality:
        return undecided(
            "No two runs are exactly equal.", "Use <= or >= with a margin, such as 105 %."
        )
    if case.info.scope is not Scope.SEARCH and case.at_hz is None:
        reason = f"The objective does not state the rate of {case.info.name}."
        return undecided(reason, "Add 'at' to the objective.")
    return None


# The values of both sides of a pair.


def run_value(
    info: MetricInfo, monitor: str | None, at_hz: float | None, samples: RunSamples
) -> float | None:
    """Return a metric of a run: the mean of its iterations; None if one of them has no value.

    If a monitor received no output in an iteration, none of its metrics has a value there.

    Args:
        info: the metric.
        monitor: for a metric of a monitor.
        at_hz: the offered rate; not used for the peak.
        samples: the run.
    """
    if info.scope is Scope.SEARCH:
        search = samples.record.search
        return search.holds_hz if search is not None else None
    if info.scope is Scope.MONITOR and monitor not in samples.monitors:
        return None
    values = [
        # Without any output a ratio of drop rates says nothing: both sides would drop everything.
        metric_value(info, monitor, sample)
        if monitor is None or sample.monitors[monitor].answered
        else None
        for sample in samples.iterations_at(at_hz)
    ]
    usable = [value for value in values if value is not None and math.isfinite(value)]
    return math.fsum(usable) / len(usable) if usable and len(usable) == len(values) else None


_HIGHEST_QUANTILE: Final = 0.95


def can_be_played_by_turns(info: MetricInfo) -> bool:
    """Return True for a metric whose ratio is measured by turns."""
    if not info.metric.by_turns:
        return False
    return info.part == "mean" or (info.quantile is not None and info.quantile <= _HIGHEST_QUANTILE)


def turn_kind(info: MetricInfo) -> TurnKind:
    """Return the kind of the segments by turns that show a metric."""
    return "work_turns" if info.scope is Scope.WORK else "turns"


def turn_values(
    info: MetricInfo, monitor: str | None, at_hz: float | None, base: RunSamples, head: RunSamples
) -> tuple[float | None, float | None]:
    """Return the values of base and head in a start of both sides.

    Their ratio is that of the metric; see the module. None if a side has no value.
    """
    kind = turn_kind(info)
    before, after = base.turns_at(kind, at_hz), head.turns_at(kind, at_hz)
    if before is None or after is None:
        return None, None
    values = metric_value(info, monitor, before), metric_value(info, monitor, after)
    if info.quantile != 0.5 or values[0] is None:
        return values
    ratio = _median_ratio(_steps(info, monitor, before), _steps(info, monitor, after))
    return values if ratio is None else (values[0], values[0] * ratio)


def _steps(info: MetricInfo, monitor: str | None, played: SegmentSamples) -> Seconds:
    """Return the values of a metric by step; NaN where a step has none."""
    if info.scope is Scope.WORK:
        return played.work.get(info.subject or WHOLE_GRAPH, np.empty(0))
    seen = played.monitors[monitor or ""]
    if not seen.knows(info.metric) or seen.expected != played.playback.sent:
        return np.empty(0)
    return values_with_lost(info, monitor, played, math.nan)


def _median_ratio(base: Seconds, head: Seconds) -> float | None:
    """Return the median of the ratios of neighbouring steps; None if there are none."""
    steps = min(base.size, head.size)
    base, head = base[:steps], head[:steps]
    known = (base > 0) & (head > 0)
    return float(np.median(head[known] / base[known])) if known.any() else None


# The decision.


def judge_ratio(
    case: RequirementCase, base: Values, head: Values, *, by_turns: bool = False
) -> RequirementVerdict:
    """Decide a requirement by the values of both sides in each pair.

    Args:
        case: its limit is the ratio that is allowed or required, such as 0.97.
        base: the base of each pair.
        head: likewise.
        by_turns: whether the pairs are starts of both sides by turns.
    """
    interval: RatioInterval | None = None
    decision = _undecidable(case) or _without_value(case, base, head)
    if decision is None and len(base) < 2:
        decision = (
            undecided("A single start does not show how starts differ.")
            if by_turns
            else undecided(
                "One pair does not show the variation between pairs.",
                "At least 2 pairs are needed; --pairs 10 gives a useful interval.",
            )
        )
    if decision is None:
        values = _known(base), _known(head)
        interval = (
            trimmed_ratio(*values, case.confidence)
            if by_turns
            else paired_ratio(*values, case.confidence, _resolution(case, max(map(max, values))))
        )
        decision = _by_interval(case, *values, interval, by_turns=by_turns)
    method: Method = "trimmed t by turns" if by_turns else "paired t on logs"
    number = interval.n if interval is not None else len(base)
    verdict = requirement_verdict(case, replace(decision, method=method, n=number))
    compared = BaselineEstimate(
        unit=case.info.unit,
        base=_geometric_mean(base),
        head=_geometric_mean(head),
        base_values=tuple(map(finite, base)),
        head_values=tuple(map(finite, head)),
        deviation=interval.deviation if interval is not None else None,
    )
    return msgspec.structs.replace(verdict, unit="share", compared=compared)


def _without_value(case: RequirementCase, base: Values, head: Values) -> Decision | None:
    """Return the decision where a side has no value, or where a value is 0; else None."""
    name = case.info.name
    if not head:
        return undecided(f"The head has no iteration in which {name} could be measured.")
    if lost := _count_missing(case, head):
        reason = f"{name} has no value in {lost} of {len(head)} iterations of the head."
        # What was not sampled says nothing of what arrived.
        if case.info.scope.is_sampled:
            return undecided(reason, "Make the iterations longer to get more samples.")
        return Decision(outcome="fail", method="none", reason=reason)
    if lost := _count_missing(case, base):
        return undecided(
            f"{name} has no value in {lost} of {len(base)} iterations of the base.",
            "Compare with a base that produces output.",
        )
    if all((*base, *head)):
        return None
    return undecided(
        f"{name} is 0 in some iterations, and a ratio to 0 is undefined.",
        "Use an absolute bound, such as 0.1 %, instead of a bound 'of baseline'.",
    )


def _by_interval(
    case: RequirementCase,
    base: Sequence[float],
    head: Sequence[float],
    interval: RatioInterval,
    *,
    by_turns: bool,
) -> Decision:
    outcome = case.outcome_of_bounds(interval.lower, interval.upper)
    before, after = (show(_geometric_mean(values), case.info.unit) for values in (base, head))
    ratio, lower, upper, limit = (
        show(value, "share", 4)
        for value in (interval.ratio, interval.lower, interval.upper, case.limit)
    )
    pieces = "starts of both" if by_turns else "pairs"
    return Decision(
        outcome=outcome,
        method="none",
        reason=f"{case.info.name} went from {before} to {after}, {ratio} of the baseline over "
        f"{interval.n} {pieces}; at {case.confidence_text} the true ratio is {lower} to {upper}, "
        f"and the limit is {limit}.",
        remedy="" if by_turns or outcome != "inconclusive" else _pairs_hint(case, interval),
        estimate=interval.ratio,
        lower=interval.lower,
        upper=interval.upper,
    )


def _pairs_hint(case: RequirementCase, interval: RatioInterval) -> str:
    n, distance = interval.n, abs(math.log(interval.ratio / case.limit))
    half = math.log(interval.upper / interval.lower) / 2
    more = more_pieces(n, mean_decides(distance, half, n, case.confidence))
    if more is None:
        return (
            f"The ratio is too close to {show(case.limit, 'share')} for pairs that differ by "
            f"{show(interval.deviation, 'share')}: widen the margin, or use a quieter machine."
        )
    return f"{advice(more, 'pairs')[:-1]} (--pairs {n + more})."


def _resolution(case: RequirementCase, typical: float) -> float:
    """Return the smallest difference that the clocks can show in a value of one iteration."""
    if case.info.scope is Scope.SEARCH or not case.iterations:
        return 0.0
    return resolution(case.info, typical, case.iterations[0].segment.length_s)


TRIMMED_FROM: Final = 6
"""Starts from which on the smallest and the largest ratio are left out."""


def trimmed_ratio(base: Sequence[float], head: Sequence[float], confidence: float) -> RatioInterval:
    """Return the ratio head / base over starts of both sides, with its one-sided bounds.

    Args:
        base: a positive value for each start, at least two.
        head: the same for the head.
        confidence: the confidence of each bound by itself.
    """
    logarithms = [math.log(after / before) for before, after in zip(base, head, strict=True)]
    return RatioInterval.of_logarithms(trimmed_interval(logarithms, confidence), len(logarithms))


def trimmed_interval(values: Sequence[float], confidence: float) -> MeanInterval:
    """Return the trimmed mean with its one-sided bounds; see the module.

    Raises:
        ValueError: fewer than two values.
    """
    n = len(values)
    if n < TRIMMED_FROM:
        return mean_interval(values, confidence)
    middle = sorted(values)[1:-1]
    h = len(middle)
    mean = math.fsum(middle) / h
    deviation = float(np.std([middle[0], *middle, middle[-1]], ddof=1))
    half = t_quantile(h - 1, confidence) * deviation * math.sqrt((n - 1) / (h * (h - 1)))
    return MeanInterval(mean=mean, lower=mean - half, upper=mean + half, deviation=deviation)


def _count_missing(case: RequirementCase, values: Values) -> int:
    # 0 is an ordinary share of drops, and an ordinary jitter: something arrived.
    least = 0.0 if case.info.may_be_zero else math.ulp(0.0)
    return sum(value is None or not least <= value < math.inf for value in values)


def _geometric_mean(values: Values) -> float | None:
    """Return the geometric mean, whose ratio is the mean ratio; None if a value is missing."""
    usable = [value for value in _known(values) if 0 < value < math.inf]
    if not usable or len(usable) < len(values):
        return None
    return math.exp(math.fsum(map(math.log, usable)) / len(usable))


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]
