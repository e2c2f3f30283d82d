"""Compares results: which results are comparable, and what their metrics show.

With m the margin and [l, u] the bounds on the true ratio head / base, each one-sided at the stated
confidence, a metric of which more is better is

    improved     if l > 1 + m
    worse        if u < 1 / (1 + m)
    the same     if l >= 1 / (1 + m) and u <= 1 + m
    undecided    otherwise

and one of which less is better the other way round. The bounds are Welch's on the logarithms of the
iterations' values, or of the means of starts where both have several
(`r2bspec.judge.statistics.t_interval`). Drop rates are compared as the shares
that arrived, with a margin of their own, because a ratio to 0 is undefined.

Subjects are run folders and results. A comparison is frozen values
that serialise to JSON.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import msgspec

from r2bspec.compare.report_input import read_report_input
from r2bspec.judge.measure.metric import MetricInfo, Scope
from r2bspec.judge.measure.metric_catalogue import find_metric, monitor_metrics
from r2bspec.judge.measure.metrics import MonitorMetrics, RateMetrics
from r2bspec.judge.measure.times import rank
from r2bspec.judge.measure.units import show
from r2bspec.judge.result import Result
from r2bspec.judge.statistics.t_interval import welch_ratio_of_runs
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.plan.comparability import (
    IncomparableError,
    brief_difference,
    graph_differences,
    load_differences,
)
from r2bspec.plan.plan import GRAPH_ROLES, Plan
from r2bspec.record.graph_identity import MACHINE_FACTS, identity_differences

Outcome = Literal["improved", "worse", "same", "can't tell"]

ADVICE = (
    "Comparisons of stored results are advisory: two runs of the same graph on a shared machine "
    "differ by more than their iterations show."
)
"""Printed below every comparison, because its intervals exclude the variation between runs."""


class ComparisonLine(msgspec.Struct, frozen=True, kw_only=True):
    """A metric at one rate.

    Attributes:
        offered_hz: None for the whole run.
        base: the metric in the base, in `unit`: the mean of its iterations, or the only value.
        ratio: head / base; for a drop rate, of the shares that arrived.
        lower: bound on the true ratio, one-sided, at `confidence` of the comparison; None where
            the variation is unknown.
        upper: likewise.
        margin: how far from 1 a ratio may be and still count as the same.
    """

    offered_hz: float | None
    monitor: str
    metric: str
    unit: str
    base: float | None
    head: float | None
    ratio: float | None
    lower: float | None
    upper: float | None
    margin: float
    outcome: Outcome
    reason: str


class ComparedSource(msgspec.Struct, frozen=True, kw_only=True):
    """A result of a comparison: its file or folder, and the run."""

    source: str
    name: str
    run_id: str
    started_at: str


class Comparison(msgspec.Struct, frozen=True, kw_only=True):
    """A result compared with the base.

    Attributes:
        differences: in plan, data or machine, a line each; those in load, data or machine occur
            only with ``--force``.
    """

    r2bspec_comparison: Literal[1] = 1
    base: ComparedSource
    head: ComparedSource
    confidence: float
    differences: tuple[str, ...]
    lines: tuple[ComparisonLine, ...]


SeriesKey = tuple[float | None, str, str]
"""Offered rate, monitor, and the metric's name in the catalogue."""


@dataclass(frozen=True)
class MetricSeries:
    """A metric in the iterations of one run.

    Attributes:
        values: None where an iteration has none, or where it is a lost message; empty where the
            monitor cannot have the metric, as no output is expected of it.
        starts: the start of the processes that each was played in; empty where it is not known.
        bracket: for the peak, the highest sustained rate and the lowest that was not.
    """

    values: tuple[float | None, ...]
    unit: str
    bracket: tuple[float | None, float | None] | None = None
    starts: tuple[int, ...] = ()


@dataclass(frozen=True)
class ComparedResult:
    """A side of a comparison.

    Attributes:
        source: its file or folder.
        plan: the plan of the run; None if only the result is known.
    """

    source: str
    result: Result
    plan: Plan | None = None

    @property
    def side(self) -> ComparedSource:
        """What a comparison says of it."""
        result = self.result
        return ComparedSource(
            source=self.source,
            name=result.name,
            run_id=result.run_id,
            started_at=result.started_at,
        )

    @property
    def dataset(self) -> str:
        """What was played: its digest, or its name; empty if unknown."""
        return str(self.result.dataset.get("sha256") or self.result.dataset.get("source") or "")

    @cached_property
    def series(self) -> dict[SeriesKey, MetricSeries]:
        """Every metric that can be compared."""
        graph = {each.name for each in self.result.processes if each.role in GRAPH_ROLES}
        series: dict[SeriesKey, MetricSeries] = {}
        for rate in self.result.metrics.rates:
            series |= _of_rate(rate, graph)
        if (search := self.result.metrics.search) is not None:
            bracket = search.holds_hz, search.upper_hz
            series[None, "", "peak.rate"] = MetricSeries(bracket[:1], "Hz", bracket=bracket)
        return series


def read_compared_result(path: Path) -> ComparedResult:
    """Read a run folder, that of a comparison, which its head represents, or a ``result.json``.

    Raises:
        RecordError: a folder is neither that of a run nor of a comparison.
        UnreadableResultError: a file is none of these.
    """
    found = read_report_input(path)
    plan = found.run.plan if found.run is not None else None
    return ComparedResult(str(path), found.result, plan)


_Values = tuple[str, str, str, list[float | None]]
"""Monitor, metric, unit, and a value for each iteration."""


def _of_rate(rate: RateMetrics, graph: set[str]) -> dict[SeriesKey, MetricSeries]:
    starts = tuple(iteration.start for iteration in rate.iterations)
    starts = starts if all(starts) else ()
    values_of = (
        *_of_monitors(rate),
        *_of_segment(rate, graph),
    )
    return {
        (rate.offered_hz, monitor, metric): MetricSeries(tuple(values), unit, starts=starts)
        for monitor, metric, unit, values in values_of
    }


def _of_monitors(rate: RateMetrics) -> Iterator[_Values]:
    for monitor in rate.pooled.monitors:
        seen = [iteration.monitors[monitor] for iteration in rate.iterations]
        for info in monitor_metrics():
            if info.part in info.metric.compared:
                values = [_value(sample, info) for sample in seen]
                yield monitor, info.name, info.unit, _possible(values, seen)


def _of_segment(rate: RateMetrics, graph: set[str]) -> Iterator[_Values]:
    """Yield the metrics of no monitor; of processes, those of the graph alone."""
    for _, info, _ in rate.pooled.entries():
        of_process = info.scope in {Scope.PROCESS, Scope.WORK} and info.subject
        if of_process and info.subject not in graph:
            continue
        for part in info.metric.compared:
            if part == info.part or info.metric.has_percentiles:
                one = msgspec.structs.replace(info, part=part)
                yield "", one.name, one.unit, [each.value(one) for each in rate.iterations]


def _possible(values: list[float | None], seen: Sequence[MonitorMetrics]) -> list[float | None]:
    """Return the values; none at all if there cannot be any, as no output was expected."""
    known = any(value is not None for value in values)
    return values if known or any(sample.is_expected for sample in seen) else []


def _value(seen: MonitorMetrics, info: MetricInfo) -> float | None:
    """Return the value of a metric; None if the percentile is a lost message."""
    q = info.quantile if info.metric.lost_is_slowest else None
    if q is not None and seen.expected and rank(q, seen.expected) > seen.count("answered"):
        return None
    return seen.value(info)


RATIO_MARGIN = 0.05
"""How far from 1 a ratio may be and still count as the same."""

SHARE_MARGIN = 0.005
"""Half a percent of the messages: the margin of the share that arrived."""

_MAX_DIFFERENCES = 12
_COMPARED_BY_RATE = frozenset({"play", "play_at_peak", "search", "monitors"})
"""Fields of a load that may differ: only metrics at the same rate and monitor are compared."""


def compare(base: ComparedResult, head: ComparedResult, *, force: bool) -> Comparison:
    """Compare one result with the base.

    Args:
        base: to compare with.
        head: to be compared.
        force: compare even with differences in load, data or machine.

    Raises:
        IncomparableError: load, data or machine differ, or they have no metric in common.
    """
    differences = require_comparable(base, head, force=force)
    lines = tuple(
        _line(key, before, after)
        for key, before in base.series.items()
        if (after := head.series.get(key)) is not None and (before.values or after.values)
    )
    if not lines:
        raise IncomparableError(
            f"{base.source} and {head.source} have no metric at the same rate in common",
            hint=f"The base was played at {_rates_text(base)}, the head at {_rates_text(head)}.",
        )
    return Comparison(
        base=base.side,
        head=head.side,
        confidence=CONFIDENCE,
        differences=tuple(differences),
        lines=lines,
    )


def require_comparable(
    base: ComparedResult, head: ComparedResult, *, force: bool
) -> tuple[str, ...]:
    """Return the differences of two results, a line each; see `compare`.

    Raises:
        IncomparableError: load, data or machine differ.
    """
    differences = tuple(differences_of(base, head))
    if not force and any(_blocking_differences(base, head)):
        raise IncomparableError(
            f"{base.source} and {head.source} are not comparable:\n"
            + "\n".join(f"  {difference}" for difference in differences),
            hint="Use --force to compare them anyway.",
        )
    return differences


def _blocking_differences(base: ComparedResult, head: ComparedResult) -> Iterator[object]:
    """Yield the differences for which a ratio says nothing about the graphs.

    Graphs that differ are what one compares.
    """
    if base.plan is not None and head.plan is not None:
        yield from (
            difference
            for difference in load_differences(base.plan, head.plan)
            if difference.path != ("dataset", "sha256")
            and difference.path[0] not in _COMPARED_BY_RATE
        )
    yield from _data_difference(base, head)
    yield from _machine_differences(base, head)


def differences_of(base: ComparedResult, head: ComparedResult) -> Iterator[str]:
    """Yield the differences of two results in plan, code, data and machine, a line each."""
    if base.plan is not None and head.plan is not None:
        yield from _plan_differences(base.plan, head.plan)
    elif base.result.plan_hash != head.result.plan_hash:
        yield (
            f"plan: {base.result.plan_hash} -> {head.result.plan_hash} "
            "(compare run folders to see the differences)"
        )
    yield from _code_differences(base, head)
    yield from _data_difference(base, head)
    yield from _machine_differences(base, head)


def _code_differences(base: ComparedResult, head: ComparedResult) -> Iterator[str]:
    was, now = base.result.identity, head.result.identity
    if was is None or now is None:
        return
    changes = identity_differences(was, now)
    yield from _some([f"code: {change}" for change in changes], "code", "changes")


def _some(lines: Sequence[str], subject: str, noun: str) -> Iterator[str]:
    """Yield the first lines, and how many more there are."""
    yield from lines[:_MAX_DIFFERENCES]
    if len(lines) > _MAX_DIFFERENCES:
        yield f"{subject}: {len(lines) - _MAX_DIFFERENCES} more {noun}"


def _data_difference(base: ComparedResult, head: ComparedResult) -> Iterator[str]:
    if base.dataset != head.dataset:
        yield f"data: {base.dataset or 'unknown'} -> {head.dataset or 'unknown'}"


def _machine_differences(base: ComparedResult, head: ComparedResult) -> Iterator[str]:
    for key in MACHINE_FACTS:
        before, after = (side.result.machine.get(key) or None for side in (base, head))
        if before != after:
            yield f"machine, {key}: {before or 'unknown'} -> {after or 'unknown'}"


def _plan_differences(base: Plan, head: Plan) -> Iterator[str]:
    lines = [
        f"plan, {brief_difference(difference)}"
        for difference in graph_differences(base, head)
        # The data have a line of their own.
        if difference.path != ("dataset", "sha256")
    ]
    yield from _some(lines, "plan", "differences")


def _rates_text(side: ComparedResult) -> str:
    """Return the rates of a result: ``10 Hz and 30 Hz``."""
    rates = sorted({rate for rate, _, _ in side.series if rate})
    return " and ".join(show(rate, "Hz") for rate in rates[:_MAX_DIFFERENCES]) or "no fixed rate"


def _line(key: SeriesKey, base: MetricSeries, head: MetricSeries) -> ComparisonLine:
    rate, monitor, metric = key
    info = find_metric(metric)
    drops = info.statistic == "share"
    margin = SHARE_MARGIN if drops else RATIO_MARGIN
    # A drop rate is compared by the share that arrived: more is better.
    before, after = (_delivered_share(value) if drops else value for value in (base, head))
    ratio_text = ratio, lower, upper = _ratio(before, after)
    bigger = info.metric.more_is_better or drops
    outcome, reason = _decide(before, ratio_text, margin, bigger=bigger)
    return ComparisonLine(
        offered_hz=rate,
        monitor=monitor,
        metric=metric,
        unit=base.unit,
        base=mean_value(base),
        head=mean_value(head),
        ratio=ratio,
        lower=lower,
        upper=upper,
        margin=margin,
        outcome=outcome,
        reason=reason,
    )


_Ratio = tuple[float | None, float | None, float | None]
"""The ratio of the head to the base, and the bounds on the true one."""


def _delivered_share(series: MetricSeries) -> MetricSeries:
    values = tuple(None if value is None else 1 - value for value in series.values)
    return MetricSeries(values, series.unit, starts=series.starts)


def mean_value(series: MetricSeries) -> float | None:
    """Return the mean over the iterations; None if any of them has no value."""
    values = [value for value in series.values if value is not None]
    return sum(values) / len(values) if len(values) == len(series.values) and values else None


def _ratio(base: MetricSeries, head: MetricSeries) -> _Ratio:
    if base.bracket is not None and head.bracket is not None:
        return _of_brackets(base.bracket, head.bracket)
    a, b = _usable(base.values), _usable(head.values)
    if a is None or b is None:
        return None, None, None
    if min(len(a), len(b)) < 2:
        return (sum(b) / len(b)) / (sum(a) / len(a)), None, None
    interval = welch_ratio_of_runs(a, b, (base.starts, head.starts), CONFIDENCE)
    return interval.ratio, interval.lower, interval.upper


def _of_brackets(
    base: tuple[float | None, float | None], head: tuple[float | None, float | None]
) -> _Ratio:
    """The peak lies somewhere in its bracket: the ratio's bounds are those of the extremes."""
    (base_holds, base_fails), (head_holds, head_fails) = base, head
    if not base_holds or not head_holds:
        return None, None, None
    lower = head_holds / base_fails if base_fails else None
    upper = head_fails / base_holds if head_fails else None
    return head_holds / base_holds, lower, upper


def _usable(values: Sequence[float | None]) -> list[float] | None:
    usable = [value for value in values if value is not None and math.isfinite(value) and value > 0]
    return usable if usable and len(usable) == len(values) else None


def _decide(
    base: MetricSeries, found: _Ratio, margin: float, *, bigger: bool
) -> tuple[Outcome, str]:
    ratio, lower, upper = found
    if ratio is None:
        if _usable(base.values) is None:
            return "can't tell", "the base has no value, or a lost one, in some iteration"
        return "worse", "the head has no value, or a lost one, in some iteration"
    if lower is None and upper is None:
        return "can't tell", "a single value does not show the variation"
    high, low = 1 + margin, 1 / (1 + margin)
    if lower is not None and upper is not None and lower >= low and upper <= high:
        return "same", f"within {show(margin, 'share')}"
    ends = [f"at least {show(lower, 'share', 4)}"] if lower is not None else []
    ends += [f"at most {show(upper, 'share', 4)}"] if upper is not None else []
    bounds = f"{' and '.join(ends)} of the base; the margin is {show(margin, 'share')}"
    if lower is not None and lower > high:
        return ("improved" if bigger else "worse"), bounds
    if upper is not None and upper < low:
        return ("worse" if bigger else "improved"), bounds
    return "can't tell", bounds
