"""The latency of every step, with the missed ones in their places."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from r2bspec.measure.matching import match_segment
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import Segment

StepLatencies = NDArray[np.float64]
"""Seconds, one for each expected output, in order; NaN for missed ones."""


def step_latencies(run: Run, segment: Segment, monitor: str) -> StepLatencies:
    """The latencies of the expected outputs of one segment at one monitor; none if unknown."""
    (plan,) = (each for each in run.plan.monitors if each.name == monitor)
    playback, rows, matched = match_segment(run, segment, plan)
    if not matched.pairs_known:
        return np.empty(0)
    found = np.full(matched.trigger_steps.size, np.nan)
    answered = matched.answered
    received = rows["received_ns"][matched.first_row[answered]]
    found[answered] = (received - playback["published_ns"][matched.trigger_steps[answered]]) / 1e9
    return found


def iterations_at(run: Run, rate_hz: float) -> Iterator[Segment]:
    """The complete iterations at a rate, in the order they were played."""
    for segment in run.record.segments:
        if (
            segment.kind == "iteration"
            and not segment.rerun_of
            and segment.complete
            and segment.rate_hz == rate_hz
        ):
            yield segment


def thin_indices(values: StepLatencies, max_points: int) -> NDArray[np.int64]:
    """Which of many values to draw: the extremes of each interval, at most `max_points` in all.

    The extremes are never left out; missing values are.
    """
    known = np.flatnonzero(~np.isnan(values))
    if known.size <= max_points:
        return known
    kept: set[int] = set()
    for part in np.array_split(known, max_points // 2):
        kept.add(int(part[np.argmin(values[part])]))
        kept.add(int(part[np.argmax(values[part])]))
    return np.array(sorted(kept), dtype=np.int64)


def missed_runs(missed: NDArray[np.bool_], max_runs: int = 400) -> list[tuple[int, int]]:
    """Runs of missed steps as (first, count); neighbours are joined if there are too many."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], missed, [False])).astype(np.int8)))
    runs = [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]
    gap = 0
    while len(runs) > max_runs:
        gap = gap * 2 + 1
        joined = [runs[0]]
        for first, end in runs[1:]:
            if first - joined[-1][1] <= gap:
                joined[-1] = (joined[-1][0], end)
            else:
                joined.append((first, end))
        runs = joined
    return [(first, end - first) for first, end in runs]
