"""What the interval of a requirement is made of, and what narrows it.

The budget
----------

An interval with one-sided bounds at the confidence c has the half width h, and (h / z_c)^2 is the
variance that it stands for. With the components of the run (`statistics.variance_components`) it
is divided into

    starts         s_S^2 sum J_i^2 / N^2          unknown with one start
    iterations     s_I^2 / N                      unknown with one iteration in each start
    sampling       v / N, without the next two
    harness        v / N times (d_H / d)^2, at most 1, where d_H is the distance of p99 and p50 of
                   the harness overhead, and d that of the messages: latencies contain the overhead
    clock          r^2 / 12 for a resolution r (JCGM 100:2008, F.2.2.1), over N for a mean
    allowance      the rest: for components that are known from few starts, iterations or bursts
                   only, by Student's t, and for correlation in time

and these add up to it, as components of an uncertainty do (JCGM 100:2008, 5.1). If the components
alone are more, which chance can make them, they are reduced in proportion and nothing is allowed
for. A metric with one value for each iteration has no messages: its sampling is a part of s_I^2,
and is said to be unknown. The overhead itself shifts a latency. That is no scatter: no interval
contains it.

What narrows it
---------------

With S' starts in place of S, with more iterations in each, or with longer ones, V becomes V', and
the information about the true value grows by the factor

    g = V / V' (t_c(S - 1) / t_c(S' - 1))^2,

with one start t over the iterations. To halve an interval needs g = 4. Of the ways that reach it
the one that takes the least time counts: a start costs what the record says that it took, and its
iterations; an iteration what it takes at all rates together. A placement of the harness, or an
idle host, is named where the harness or the affected iterations make up three quarters of V; where
the clock makes up half of it, nothing that is added narrows it.

An open requirement is advised in the same way, with the g that decides it in 8 of 10 runs: starts
where their variance, or their small number, limits; iterations where these reach it in less time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from r2bspec.diagnostics.quote import time_text
from r2bspec.judge.measure.host_usage import interference_reasons, median_pressure
from r2bspec.judge.measure.metric_catalogue import MetricInfo
from r2bspec.judge.measure.samples import LOSS_SENSITIVE_FAMILIES, SegmentSamples
from r2bspec.judge.measure.units import show
from r2bspec.judge.statistics.t_interval import t_quantile
from r2bspec.judge.statistics.variance_components import (
    ASSURANCE,
    MAX_PIECES,
    NestedSample,
    pieces_for,
    sampling_variance,
)
from r2bspec.judge.verdict import UncertaintyBudget, VariancePart, VarianceSource
from r2bspec.record.run_record import RunRecord

if TYPE_CHECKING:
    from r2bspec.judge.requirement_case import RequirementCase


_HALVED: Final = 4.0
_MAX_LONGER: Final = 10.0
"""By more than this, iterations are not proposed to be longer."""

_CLEAR_CLOCK: Final = 0.1
"""With a smaller share of the variance, the resolution of the clock limits nothing."""

_MAX_ITERATIONS: Final = 400
"""More are not proposed."""

_CLOCK_RESOLUTION_S = 1e-6
"""Times are taken by software between system calls: nothing below a microsecond is meaningful."""

_CPU_TICK_S = 0.01
"""Linux accounts processor time in ticks of 10 ms."""

_PAGE_BYTES = 4096.0


@dataclass(frozen=True)
class Costs:
    """What parts of a run take, in seconds.

    Attributes:
        start: until its first iteration.
        iteration: the playing of one, at all rates together.
        gap: from the end of an iteration to the next one.
    """

    start: float = 0.0
    iteration: float = 0.0
    gap: float = 0.0

    @classmethod
    def of(cls, iterations: Sequence[SegmentSamples], record: RunRecord) -> Costs:
        """Those of the run with these iterations at one rate."""
        played = [
            segment
            for segment in record.segments
            if segment.kind == "iteration" and segment.complete
        ]
        starts = [start.cost_ns for start in record.starts if not start.confirms]
        gaps = [
            max(later.began_ns - earlier.ended_ns, 0)
            for earlier, later in pairwise(played)
            if later.start == earlier.start
        ]
        return cls(
            start=_median(starts[1:] or starts),
            iteration=sum(segment.length_s for segment in played) / max(len(iterations), 1),
            gap=_median(gaps),
        )


def _median(times_ns: Sequence[int]) -> float:
    return float(np.median(times_ns)) / 1e9 if times_ns else 0.0


@dataclass(frozen=True)
class Addition:
    """A way to narrow an interval.

    Attributes:
        what: what there is more of.
        number: starts or iterations in all, or by how much an iteration is longer.
        iterations: in all.
        seconds: of run time that it adds.
    """

    what: Literal["starts", "iterations", "length"]
    number: float
    iterations: int
    seconds: float


@dataclass(frozen=True)
class Observations:
    """What an estimate is the mean of, over the density where that is a percentile.

    Attributes:
        values: one for each iteration.
        starts: of the iterations.
        rows: the messages behind the values; empty where there are none.
        by_level: whether the interval rests on the scatter of starts or iterations, so that few
            of them make it wide by Student's t.
        scale: from a value to the unit of the metric.
    """

    values: Sequence[float]
    starts: Sequence[int]
    rows: Sequence[NDArray[np.float64]] = ()
    by_level: bool = True
    scale: float = 1.0

    @cached_property
    def whole(self) -> NestedSample:
        """The components by all iterations."""
        return self.sample(range(len(self.values)))

    def sample(self, kept: Sequence[int]) -> NestedSample:
        """The components by the iterations at some places."""
        return NestedSample.of(
            [self.values[at] for at in kept],
            [self.starts[at] for at in kept],
            sampling_variance([self.rows[at] for at in kept]) if self.rows else 0.0,
        )


def additions(
    observed: Observations, growth: float, confidence: float, costs: Costs
) -> Iterator[Addition]:
    """The ways that reach a g, if no more than can be proposed is needed.

    Args:
        observed: the run.
        growth: g, above 1.
        confidence: of the bounds, by which few starts count less.
        costs: of its parts.
    """
    sample = observed.whole
    s, n, v = len(sample.sizes), sample.number, sample.variance
    # Where nothing varies, as without a bad message, only the number of messages is known to count.
    fixed, lasting = ((part / v if v else 0.0) for part in (sample.by_starts, sample.by_iterations))
    known_from = confidence if observed.by_level else None
    if s > 1 and (number := pieces_for(growth, s, known_from)) is not None:
        whole = math.ceil(n / s * number)
        seconds = (number - s) * costs.start + (whole - n) * (costs.iteration + costs.gap)
        yield Addition("starts", number, whole, seconds)
    whole = n
    if s == 1:
        whole = pieces_for(growth, n, known_from) or n
    elif n > s and fixed * growth < 1:
        whole = s * math.ceil((1 - fixed) * growth / (1 - fixed * growth) * n / s)
    if n < whole <= _MAX_ITERATIONS:
        seconds = (whole - n) * (costs.iteration + costs.gap)
        yield Addition("iterations", whole, whole, seconds)
    left = 1 / growth - fixed - lasting
    if observed.rows and left > 0:
        longer = (1 - fixed - lasting) / left
        if longer <= _MAX_LONGER:
            yield Addition("length", longer, n, n * (longer - 1) * costs.iteration)


def deciding_addition(
    observed: Observations, growth: float, confidence: float, costs: Costs
) -> Addition | None:
    """The way that is advised to decide a requirement, if any does.

    Longer iterations are advised only where nothing else does, and messages limit.
    """
    if not math.isfinite(growth):
        return None
    ways = list(additions(observed, growth, confidence, costs))
    counted = [way for way in ways if way.what != "length"]
    allowed = counted or ([] if observed.by_level else ways)
    return min(allowed, key=lambda one: one.seconds, default=None)


def deciding_text(addition: Addition, starts: int, messages: str = "") -> str:
    """The advice as a sentence.

    Args:
        addition: what is advised.
        starts: of the run.
        messages: how many messages these are, in words; empty where none are counted.
    """
    time = time_text(addition.seconds) if addition.seconds > 0 else ""
    aside = ", ".join(filter(None, (messages, f"{time} more" if time else "")))
    return (
        f"About {_addition_text(addition, starts)}{f' ({aside})' if aside else ''} would decide "
        f"it in {10 * ASSURANCE:.0f} of 10 such runs."
    )


def _addition_text(addition: Addition, starts: int) -> str:
    match addition.what:
        case "starts":
            return f"{addition.number:.0f} starts with {addition.iterations} iterations"
        case "iterations":
            return f"{addition.iterations} iterations{f' in {starts} starts' * (starts > 1)}"
    return f"iterations {show(addition.number, '', 2)} times as long"


def resolution(info: MetricInfo, typical: float, window_s: float) -> float:
    """The smallest difference in a value of a metric that the clocks can show.

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


def uncertainty_budget(
    case: RequirementCase,
    record: RunRecord,
    observed: Observations,
    bounds: tuple[float, float, float],
    rounding: float,
) -> UncertaintyBudget | None:
    """The budget of a decision; None where the interval is unbounded, or has no width.

    Args:
        case: that is decided.
        record: of the run.
        observed: what the estimate is made of.
        bounds: the estimate, and its lower and its upper bound.
        rounding: the standard deviation of the estimate by the resolution of the clock.
    """
    estimate, lower, upper = bounds
    sides = [side for side in (estimate - lower, upper - estimate) if math.isfinite(side)]
    half = math.fsum(sides) / max(len(sides), 1)
    if not half > 0 or not math.isfinite(estimate):
        return None
    sample = observed.whole
    whole = (half / t_quantile(math.inf, case.confidence)) ** 2
    square = observed.scale**2
    starts, iterations, sampling = (
        part * square for part in (sample.by_starts, sample.by_iterations, sample.by_sampling)
    )
    clock = min(rounding**2, whole)
    harness = _harness_share(case, record)
    sampling -= (by_harness := (harness or 0.0) * sampling)
    variances: dict[VarianceSource, float] = {
        "starts": starts,
        "iterations": iterations,
        "sampling": sampling,
        "harness": by_harness,
    }
    # What the clock rounds is a part of what scatters.
    scatter = math.fsum(variances.values())
    rest = max(scatter - clock, 0.0)
    limit = (whole - clock) / rest if rest > whole - clock else 1.0
    parts = {
        source: variance * (rest / scatter if scatter else 0.0) * limit
        for source, variance in variances.items()
    } | {"clock": clock}
    parts["allowance"] = max(whole - math.fsum(parts.values()), 0.0)
    unknown = _unknown(case, observed, sample, harness)
    halved, seconds = _halving(case, record, observed, parts)
    return UncertaintyBudget(
        half_width=half,
        parts=tuple(
            VariancePart(source=source, unknown=unknown[source])
            if source in unknown
            else VariancePart(
                source=source,
                # Digits that the order of additions decides are cut off.
                share=round(variance / whole, 6),
                deviation=float(f"{math.sqrt(variance):.6g}"),
            )
            for source, variance in parts.items()
        ),
        halve=halved,
        halve_s=seconds,
    )


def _unknown(
    case: RequirementCase, observed: Observations, sample: NestedSample, harness: float | None
) -> dict[VarianceSource, str]:
    """The sources that cannot be told apart, and why."""
    reasons: dict[VarianceSource, str] = {}
    starts, number = len(sample.sizes), sample.number
    if starts == 1:
        reasons["starts"] = "One start does not show by how much starts differ."
    if number == 1:
        reasons["iterations"] = "One iteration does not show by how much iterations differ."
    elif number == starts:
        reasons["iterations"] = "With one iteration in each start, iterations are a part of starts."
    if not observed.rows:
        level = "starts" if number == starts > 1 else "iterations"
        reasons["sampling"] = (
            f"The metric has one value for each iteration: sampling is in {level}."
        )
    if harness is None:
        reasons["harness"] = (
            "The harness overhead was not measured."
            if case.info.family in LOSS_SENSITIVE_FAMILIES
            else "The harness overhead is known for latencies only."
        )
    return reasons


def _harness_share(case: RequirementCase, record: RunRecord) -> float | None:
    """(d_H / d)^2 of the messages of a latency; None where it is not known."""
    if case.info.family not in LOSS_SENSITIVE_FAMILIES or case.monitor is None:
        return None
    spreads = [
        overhead.latency_p99_ns - overhead.latency_p50_ns
        for overhead in record.harness_overhead
        if overhead.latency_p50_ns is not None and overhead.latency_p99_ns is not None
    ]
    messages = np.concatenate(
        [monitor_sample.times[case.info.family] for monitor_sample in case.monitor_samples]
    )
    if not spreads or not messages.size:
        return None
    middle, tail = np.quantile(messages, (0.5, 0.99))
    if not tail > middle:
        return 1.0
    return min(1.0, (max(spreads) / 1e9 / float(tail - middle)) ** 2)


def _halving(
    case: RequirementCase,
    record: RunRecord,
    observed: Observations,
    parts: Mapping[VarianceSource, float],
) -> tuple[str, float | None]:
    """What halves the interval, and the seconds that it adds."""
    whole = math.fsum(parts.values())
    scatter = whole - parts["allowance"]
    # Of few messages, which may agree by chance, the allowance is nearly the whole.
    if parts["clock"] > max(scatter / 2, _CLEAR_CLOCK * whole):
        return "The resolution of the clock limits it.", None
    if parts["harness"] > scatter * (1 - 1 / _HALVED):
        return "Another 'harness.placement' would more than halve it.", None
    usual = median_pressure([iteration.interference for iteration in case.iterations])
    kept = [
        at
        for at, iteration in enumerate(case.iterations)
        if not interference_reasons(iteration.interference, usual)
    ]
    affected = len(observed.values) - len(kept)
    if affected and len(case.iterations) == len(observed.values) and len(kept) > 1:
        sample, calm = observed.whole, observed.sample(kept)
        if calm.variance * calm.number * _HALVED <= sample.variance * sample.number:
            text = f"others affected {affected} of {len(observed.values)} iterations"
            return f"An idle host would more than halve it: {text}.", None
    # Where nothing bad was met, the bound on it falls with the number of messages (rule of three).
    growth = _HALVED if observed.whole.variance else math.sqrt(_HALVED)
    ways = additions(observed, growth, case.confidence, Costs.of(case.iterations, record))
    best = min(ways, key=lambda one: one.seconds, default=None)
    if best is None:
        return f"Neither {MAX_PIECES} starts nor {_MAX_ITERATIONS} iterations halve it.", None
    added = f", about {time_text(best.seconds)} more" if best.seconds > 0 else ""
    text = _addition_text(best, len(set(observed.starts)))
    return f"To halve it: {text}{added}.", round(best.seconds, 3)
