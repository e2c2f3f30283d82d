"""Charts of the latency: by percentile, on an axis that expands the tail, and by message."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.distribution import quantile
from r2bspec.judge.measure.metrics import pace_of
from r2bspec.judge.measure.sample_table import MonitorSamples
from r2bspec.judge.measure.samples import RunSamples, SegmentSamples, known_latencies
from r2bspec.judge.measure.units import at_rate, show, show_rate
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.report.document import Chart
from r2bspec.report.html.chart import (
    OUTCOME_INKS,
    Axis,
    Label,
    Panel,
    Series,
    Strokes,
    dashes,
    draw,
    ink,
    value_axis,
)

StepLatencies = NDArray[np.float64]
"""Seconds, one for each expected output, in order; NaN for missed ones."""


def step_latencies(seen: MonitorSamples) -> StepLatencies:
    """Return the latencies of the expected outputs of a segment at a monitor; none if unknown."""
    latencies = seen.latency
    if seen.unknown_latency or (seen.own_pace and not latencies.size):
        return np.empty(0)
    return seen.latency_by_step


def has_latencies(samples: RunSamples, monitor: str) -> bool:
    """Return True if outputs with a latency were expected of a monitor.

    Outputs of a timer have none.
    """
    segments = (segment for played in samples.iterations.values() for segment in played)
    return any(step_latencies(segment.monitors[monitor]).size for segment in segments)


_CURVE_POINTS: Final = 300

_MAX_CURVES: Final = 24
"""The legend of more curves leaves them no room."""

_MIN_LOG_RATIO: Final = 20.0
"""From this ratio of the largest latency to the median on, the latency axis is logarithmic."""

_SHARES: Final = (
    *((1.0, "0 %"), (2.0, "50 %"), (10.0, "90 %"), (20.0, "95 %"), (1e2, "99 %")),
    *((1e3, "99.9 %"), (1e4, "99.99 %"), (1e5, "99.999 %"), (1e6, "99.9999 %")),
)
"""The ticks of the axis of shares, at n for the share 1 - 1/n."""


def percentile_chart(name: str, monitor: str, samples: RunSamples, verdict: Verdict) -> Chart:
    """Draw a curve for each offered rate, with the limits and bounds of its requirements.

    Args:
        name: the name of the chart, unique in its page.
        monitor: its name.
        samples: the samples of the run.
        verdict: the verdict of the run.
    """
    all_rates = sorted(samples.iterations)
    rates = all_rates[-_MAX_CURVES:]
    texts = [show_rate(rate, pace_of(samples.mode)) for rate in rates]
    title = f"Latency by percentile: {monitor}"
    if len(all_rates) > len(rates):
        title += f", the highest {len(rates)} of {len(all_rates)} rates"
    marks: list[Series | Strokes | Label] = []
    largest, medians, total = 0.0, [], 2
    for number, (rate, text) in enumerate(zip(rates, texts, strict=True)):
        seen = [iteration.monitors[monitor] for iteration in samples.iterations[rate]]
        values, lost = np.sort(known_latencies(seen)), sum(one.missed for one in seen)
        total = max(total, values.size + lost)
        if values.size:
            largest = max(largest, float(values[-1]))
            medians.append(float(np.median(values)))
            marks += _curve(number, text, values, lost)
    for limit in verdict.requirements:
        if limit.monitor == monitor and limit.at_hz in rates:
            marks += _percentile_limit(limit, rates.index(limit.at_hz))
    heights = [up for mark in marks for up in _heights(mark)]
    is_wide = bool(medians) and largest > _MIN_LOG_RATIO * min(medians)
    across = Axis(
        *("share of messages at or below", "percentile"),
        *(1.0, max(total * 1.8, 20.0)),
        logarithmic=True,
        ticks=_SHARES,
    )
    panel = Panel(across, value_axis("latency, ms", "ms", heights, logarithmic=is_wide), marks, 240)
    description = (
        f"Latency of {monitor} by percentile, one curve for each of {', '.join(texts)}. The "
        "horizontal axis is logarithmic in the share of messages that took longer."
    )
    return draw(name, title, description, [panel])


def _heights(mark: Series | Strokes | Label) -> Iterator[float]:
    if isinstance(mark, Series):
        yield from (up for _, up in mark.points)
    elif isinstance(mark, Strokes):
        yield from (up for line in mark.lines for _, up in line)


def _curve(
    number: int, text: str, values: NDArray[np.float64], lost: int
) -> Iterator[Series | Label]:
    """Yield a step for each rank k of n: the value at or below which a share of k/n lies."""
    n = values.size + lost
    ranks = np.arange(1, values.size + 1)
    if values.size > _CURVE_POINTS:
        # Denser near the largest.
        from_end = np.unique(np.geomspace(1, values.size, _CURVE_POINTS).astype(np.int64))
        ranks = (values.size + 1 - from_end)[::-1]
    # The largest one would be at infinity.
    ends = n / np.maximum(n - ranks, 0.6)
    ups = values[ranks - 1] * 1e3
    begins = np.concatenate(([1.0], ends[:-1]))
    corners = np.column_stack((begins, ups, ends, ups)).reshape(-1, 2).tolist()
    points = [(x, y) for x, y in corners]
    yield Series(points, text, ink(number), legend=text, dashes=dashes(number))
    if lost:
        x, y = points[-1]
        yield Series([(x, y)], f"{text}: lost", ink(number), joined=False, mark="triangle")
        yield Label(f"{show(lost / n, 'share')} lost", x, y, ink(number))


def _percentile_limit(one: RequirementVerdict, number: int) -> Iterator[Strokes | Label]:
    """Yield the limit of a percentile as a bar, with the bounds of the estimate.

    The limit of a ratio is on no axis.
    """
    family, _, part = one.metric.rpartition(".")
    q = quantile(part)
    if one.compared is not None or not family.endswith("latency") or q is None or not one.limit:
        return
    x, y, outcome = 1 / (1 - q), one.limit * 1e3, OUTCOME_INKS[one.outcome]
    yield Strokes([((x / 1.6, y), (x * 1.6, y))], outcome, 3)
    if one.lower is not None and one.upper is not None and np.isfinite(one.upper):
        bounds = ((x, one.lower * 1e3), (x, one.upper * 1e3))
        yield Strokes([bounds], ink(number), 6, opacity=0.45)
    # On the side of the bar without the curve.
    above = not one.lost and one.estimate is not None and one.limit > one.estimate
    text = f"{part} limit {show(one.limit, one.unit)} {at_rate(one.at_hz or 0.0)}"
    yield Label(text, x, y, outcome, above=above)


_MAX_POINTS: Final = 1_200
"""Messages that are drawn for each rate."""

_MAX_STROKES: Final = 400
"""Iterations that are drawn apart, and misses: more of them would be an area."""

_MESSAGE_RATES: Final = 6

_WORST_FIRST: Final = ("fail", "inconclusive", "pass")


def messages_chart(name: str, monitor: str, samples: RunSamples, verdict: Verdict) -> Chart:
    """Draw a row for each offered rate; iterations follow each other from left to right.

    See `percentile_chart`.
    """
    rates = sorted(samples.iterations)
    shown = rates[-_MESSAGE_RATES:]
    panels = []
    for number, rate in enumerate(shown, start=len(rates) - len(shown)):
        limits = [
            one
            for one in verdict.requirements
            # The limit of a ratio is no time.
            if (one.monitor, one.at_hz, one.compared) == (monitor, rate, None)
            and "latency." in one.metric
        ]
        title = "message" if rate == shown[-1] else ""
        played = samples.iterations[rate]
        panels.append(_messages(number, rate, monitor, played, samples.mode, limits, title))
    notes = []
    longest = max(
        (sum(step_latencies(one.monitors[monitor]).size for one in samples.iterations[rate]))
        for rate in shown
    )
    if longest > _MAX_POINTS:
        notes.append(
            f"In rows of more than {_MAX_POINTS:,} messages, only the fastest and the slowest "
            "of each interval are drawn."
        )
    if len(shown) < len(rates):
        notes.append(f"The highest {len(shown)} of {len(rates)} rates are drawn.")
    description = (
        f"Latency of each message at {monitor}, in the order of playing, a row for each offered "
        "rate. Bars at the top of a row are missed messages; vertical lines separate iterations."
    )
    return draw(name, f"Latency by message: {monitor}", description, panels, " ".join(notes))


def _messages(
    number: int,
    rate: float,
    monitor: str,
    played: Sequence[SegmentSamples],
    mode: str,
    limits: Sequence[RequirementVerdict],
    title: str,
) -> Panel:
    """Return the row of a rate."""
    parts = [step_latencies(one.monitors[monitor]) for one in played]
    values = np.concatenate(parts) if parts else np.empty(0)
    kept = thin_indices(values, _MAX_POINTS)
    points = np.column_stack((kept + 1, values[kept] * 1e3)).tolist()
    last = max(values.size, 1) + 0.5
    top = max((up for _, up in points), default=1.0)
    top = max([top, *((one.limit or 0.0) * 1e3 for one in limits)])
    label = show_rate(rate, pace_of(mode))
    marks: list[Series | Strokes] = [
        Series(points, label, ink(number), joined=False, mark="dot"),
        *(
            Strokes(
                [((0.5, one.limit * 1e3), (last, one.limit * 1e3))],
                OUTCOME_INKS[one.outcome],
                dashes="5 4",
            )
            for one in limits
            if one.limit is not None
        ),
    ]
    ends = np.cumsum([part.size for part in parts])[:-1] + 0.5
    if len(parts) <= _MAX_STROKES:
        marks.append(Strokes([((end, 0), (end, top * 1.25)) for end in ends], "quiet", 0.6))
    missed = np.isnan(values)
    bars = [
        ((first + 0.5, top * 1.2), (end + 0.5, top * 1.2)) for first, end in missed_runs(missed)
    ]
    if bars:
        marks.append(Strokes(bars, "bad", 7))
    count = int(missed.sum())
    missing = f"{count:,}" if count else "none"
    worst = min((one.outcome for one in limits), key=_WORST_FIRST.index, default="pass")
    return Panel(
        Axis(title, "message", 0.5, last),
        Axis(f"{label}, ms", "ms", 0.0, top * 1.25),
        marks,
        110,
        left="limit: " + " · ".join(one.text.strip() for one in limits) if limits else "",
        # What the source of a live graph sent is unknown.
        right=f"{values.size:,} messages"
        if mode == "live"
        else f"{missing} of {values.size:,} missed",
        title_ink=OUTCOME_INKS[worst] if limits else "quiet",
    )


def thin_indices(values: StepLatencies, max_points: int) -> NDArray[np.int64]:
    """Return which values to draw: the extremes of each interval, at most `max_points` in all.

    The extremes are never left out; missing values are.
    """
    known = np.flatnonzero(~np.isnan(values))
    if known.size <= max_points:
        return known
    parts = np.array_split(known, max_points // 2)
    extremes = [part[pick(values[part])] for part in parts for pick in (np.argmin, np.argmax)]
    return np.unique(np.array(extremes, dtype=np.int64))


def missed_runs(missed: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the runs of missed steps as half-open ranges; of many runs, neighbours are joined."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], missed, [False])).astype(np.int8)))
    runs = [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]
    gap = 0
    while len(runs) > _MAX_STROKES:
        gap = gap * 2 + 1
        joined = [runs[0]]
        for first, end in runs[1:]:
            if first - joined[-1][1] <= gap:
                joined[-1] = (joined[-1][0], end)
            else:
                joined.append((first, end))
        runs = joined
    return runs
