"""The comparison itself: which results may be compared, and what their numbers allow to say.

With m the margin and [l, u] the bounds on the true ratio head / base, each one-sided at the stated
confidence, a metric of which more is better is

    improved     if l > 1 + m
    worse        if u < 1 / (1 + m)
    the same     if l >= 1 / (1 + m) and u <= 1 + m
    open         otherwise

and one of which less is better the other way round. The bounds are Welch's on the logarithms of the
iterations' values (`r2bspec.judge.statistics.welch_t`). Drop rates are compared as the shares
that did arrive, with a margin of their own, because 0 has no ratio to anything.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from r2bspec.compare.comparison import Comparison, ComparisonLine, Outcome
from r2bspec.compare.comparison_subject import ComparedResult, MetricSeries, SeriesKey
from r2bspec.compare.errors import IncomparableError
from r2bspec.judge.statistics.welch_t import welch_ratio
from r2bspec.language.confidence import CONFIDENCE
from r2bspec.measure.units import show
from r2bspec.plan.comparability import graph_differences
from r2bspec.plan.plan import Plan
from r2bspec.record.machine_fingerprint import MACHINE_FACTS

SHARE_MARGIN = 0.005
"""Half a percent of the messages: the margin of what arrived."""

_BIGGER_IS_BETTER = ("throughput.mean", "peak.rate")
_MAX_DIFFERENCES = 12


def compare(
    base: ComparedResult, head: ComparedResult, *, margin: float, force: bool
) -> Comparison:
    """Compare one result with the base.

    Args:
        base: what to compare with.
        head: what to compare.
        margin: a ratio nearer to 1 than this counts as the same; 0.05 is 5 %.
        force: compare results of different plans, data or machines, too.

    Raises:
        IncomparableError: they differ in more than their numbers, or share no number at all.
    """
    differences = tuple(differences_of(base, head))
    if differences and not force:
        raise IncomparableError(
            f"{base.side.source} and {head.side.source} are not results of the same thing:\n"
            + "\n".join(f"  {each}" for each in differences),
            hint="--force compares them all the same.",
        )
    lines = tuple(_lines(base, head, margin))
    if not lines:
        raise IncomparableError(
            f"{base.side.source} and {head.side.source} have no metric at the same rate in common"
        )
    return Comparison(
        base=base.side, head=head.side, confidence=CONFIDENCE, differences=differences, lines=lines
    )


def differences_of(base: ComparedResult, head: ComparedResult) -> Iterator[str]:
    """In what two results differ beside their numbers, a line each."""
    if base.tool != head.tool:
        yield f"tool: {base.tool} -> {head.tool}, which measure by different rules"
    elif base.tool != "r2bspec":
        yield f"plan and data: not known, because they are reports of {base.tool}"
    if base.plan is not None and head.plan is not None:
        yield from _plan_differences(base.plan, head.plan)
    elif base.plan_hash != head.plan_hash:
        yield (
            f"plan: {base.plan_hash or 'not known'} -> {head.plan_hash or 'not known'} "
            "(run folders would tell what differs)"
        )
    if base.dataset != head.dataset:
        yield f"data: {base.dataset or 'not known'} -> {head.dataset or 'not known'}"
    for key in MACHINE_FACTS:
        before, after = ((side.machine or {}).get(key) or None for side in (base, head))
        # What a report of another tool leaves open has been told already.
        if before != after and (base.tool == head.tool or None not in {before, after}):
            yield f"machine, {key}: {before or 'not known'} -> {after or 'not known'}"


def _plan_differences(base: Plan, head: Plan) -> Iterator[str]:
    found = graph_differences(base, head)
    # The data has a line of its own.
    found = [each for each in found if each.path != ("dataset", "sha256")]
    yield from (f"plan, {each}" for each in found[:_MAX_DIFFERENCES])
    if len(found) > _MAX_DIFFERENCES:
        yield f"plan: {len(found) - _MAX_DIFFERENCES} more differences"


def _lines(base: ComparedResult, head: ComparedResult, margin: float) -> Iterator[ComparisonLine]:
    for key, before in base.series.items():
        other = _matching_key(key, head)
        if other is not None:
            yield _line(key, before, head.series[other], margin)


def _matching_key(key: SeriesKey, head: ComparedResult) -> SeriesKey | None:
    """The same metric of the head. A monitor without a name is any monitor, if there is one."""
    if key in head.series:
        return key
    rate, monitor, metric = key
    same = [each for each in head.series if (each[0], each[2]) == (rate, metric)]
    return same[0] if len(same) == 1 and not (monitor and same[0][1]) else None


def _line(key: SeriesKey, base: MetricSeries, head: MetricSeries, margin: float) -> ComparisonLine:
    rate, monitor, metric = key
    drops = metric == "drop_rate"
    margin = SHARE_MARGIN if drops else margin
    before, after = (
        _delivered_share(base) if drops else base,
        _delivered_share(head) if drops else head,
    )
    ratio, lower, upper = _ratio(before, after)
    # What arrived is better the more it is, and so is the rest of a drop rate.
    bigger = metric in _BIGGER_IS_BETTER or drops
    outcome, reason = _decide(before, (ratio, lower, upper), margin, bigger=bigger)
    return ComparisonLine(
        offered_hz=rate,
        monitor=monitor,
        metric=metric,
        unit=base.unit,
        base=_mean(base),
        head=_mean(head),
        ratio=ratio,
        lower=lower,
        upper=upper,
        margin=margin,
        outcome=outcome,
        reason=reason,
    )


def _delivered_share(series: MetricSeries) -> MetricSeries:
    values = tuple(None if value is None else 1 - value for value in series.values)
    return MetricSeries(values, series.unit, series.single)


def _mean(series: MetricSeries) -> float | None:
    known = [value for value in series.values if value is not None]
    return sum(known) / len(known) if len(known) == len(series.values) and known else None


def _ratio(
    base: MetricSeries, head: MetricSeries
) -> tuple[float | None, float | None, float | None]:
    if base.bracket is not None and head.bracket is not None:
        return _of_brackets(base.bracket, head.bracket)
    a, b = _usable(base.values), _usable(head.values)
    if a is None or b is None:
        return None, None, None
    if min(len(a), len(b)) < 2:
        return (sum(b) / len(b)) / (sum(a) / len(a)), None, None
    found = welch_ratio(a, b, CONFIDENCE)
    return found.ratio, found.lower, found.upper


def _of_brackets(
    base: tuple[float | None, float | None], head: tuple[float | None, float | None]
) -> tuple[float | None, float | None, float | None]:
    """The peak lies somewhere in its bracket: the ratio's bounds are those of the extremes."""
    (base_holds, base_fails), (head_holds, head_fails) = base, head
    if not base_holds or not head_holds:
        return None, None, None
    lower = head_holds / base_fails if base_fails else None
    upper = head_fails / base_holds if head_fails else None
    return head_holds / base_holds, lower, upper


def _usable(values: Sequence[float | None]) -> list[float] | None:
    known = [value for value in values if value is not None and math.isfinite(value) and value > 0]
    return known if known and len(known) == len(values) else None


def _decide(
    base: MetricSeries,
    found: tuple[float | None, float | None, float | None],
    margin: float,
    *,
    bigger: bool,
) -> tuple[Outcome, str]:
    ratio, lower, upper = found
    if ratio is None:
        if _usable(base.values) is None:
            return "can't tell", "the base has no value, or one that was lost, in some iteration"
        return "worse", "a value that the base has is missing or was lost in some iteration"
    if lower is None and upper is None:
        return "can't tell", "a single value shows no spread"
    high, low = 1 + margin, 1 / (1 + margin)
    if lower is not None and lower > high:
        return ("improved" if bigger else "worse"), _bounds_text(found, margin)
    if upper is not None and upper < low:
        return ("worse" if bigger else "improved"), _bounds_text(found, margin)
    if lower is not None and upper is not None and lower >= low and upper <= high:
        return "same", f"within {show(margin, 'share')}"
    return "can't tell", _bounds_text(found, margin)


def _bounds_text(found: tuple[float | None, float | None, float | None], margin: float) -> str:
    _, lower, upper = found
    ends = [f"at least {_percent(lower)}"] if lower is not None else []
    ends += [f"at most {_percent(upper)}"] if upper is not None else []
    return f"{' and '.join(ends)} of the base; the margin is {show(margin, 'share')}"


def _percent(ratio: float | None) -> str:
    return show(ratio, "share", 4)
