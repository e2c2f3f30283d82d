"""Processor time and memory of a process over an interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from r2bspec.record.sample_arrays import Rows


@dataclass(frozen=True)
class ResourceUse:
    """What a process, or the machine, used in a window.

    Attributes:
        cpu_mean: processor time per time; 1 is one core. None if too little was sampled.
        cpu_max: the largest of the same between two samples at least `MIN_SPACING_NS` apart.
        memory_max_bytes: the largest resident set at a sample, or None without one.
        waited: the run-queue wait of all its threads per time; it exceeds 1 if several wait at
            once. None if the kernel counts none, or too little was sampled.
        minor_faults: the page faults without reading from disk in the window; None likewise.
    """

    cpu_mean: float | None
    cpu_max: float | None
    memory_max_bytes: int | None
    waited: float | None = None
    minor_faults: float | None = None


MACHINE_INDEX = -1
"""The process index of the whole machine."""

CONTROLLER_INDEX = -2
"""The process index of the controller itself, which is not a process of the run's plan."""

ORPHANS_INDEX = -3
"""The process index of processes of the run that are known to descend from none of its plan."""


MIN_SPACING_NS = 100_000_000
"""Processor time is counted in ticks of 10 ms: a rate needs several of them."""


def spaced_indices(times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """The indices of ascending times at least `MIN_SPACING_NS` apart; the last one is kept."""
    kept: list[int] = []
    for index, time_ns in enumerate(times_ns.tolist()):
        if not kept or time_ns - times_ns[kept[-1]] >= MIN_SPACING_NS:
            kept.append(index)
    if kept and kept[-1] != times_ns.size - 1:
        kept[-1:] = [times_ns.size - 1] if len(kept) > 1 else [kept[-1], times_ns.size - 1]
    return np.array(kept, dtype=np.int64)


def resource_use(
    resources: Rows, processes: frozenset[int], began_ns: int, ended_ns: int
) -> ResourceUse | None:
    """What some processes together used between two times, or None if nothing was sampled then.

    With C(t) the processor time used up to t, interpolated linearly between samples,

        cpu_mean = (C(ended) - C(began)) / (ended - began)

    so that time outside the window does not count, whatever the sampling period. Samples must
    cover at least half of the window; the rest is left out of both differences.

    Args:
        resources: rows of type `RESOURCE_DTYPE`, in any order.
        processes: the indices to add up; several where a name was started more than once.
        began_ns: the beginning of the window.
        ended_ns: its end.
    """
    found = [
        one
        for index in sorted(processes)
        if (one := _process_use(resources, index, began_ns, ended_ns)) is not None
    ]
    if not found:
        return None
    if len(found) == 1:
        return found[0]
    return ResourceUse(
        cpu_mean=_sum([one.cpu_mean for one in found]),
        # The busiest moments need not coincide: their sum is an upper bound.
        cpu_max=_sum([one.cpu_max for one in found]),
        memory_max_bytes=sum(one.memory_max_bytes or 0 for one in found),
        waited=_sum([one.waited for one in found]),
        minor_faults=_sum([one.minor_faults for one in found]),
    )


def _process_use(resources: Rows, index: int, began_ns: int, ended_ns: int) -> ResourceUse | None:
    rows = resources[resources["process"] == index]
    rows = rows[np.argsort(rows["time_ns"], kind="stable")]
    inside = (rows["time_ns"] >= began_ns) & (rows["time_ns"] <= ended_ns)
    if rows.size < 2 or rows["time_ns"][-1] <= began_ns or rows["time_ns"][0] >= ended_ns:
        return None
    memory = rows["memory_bytes"][inside]
    memory_max = int(memory.max()) if memory.size else None
    times = rows["time_ns"]
    start, end = max(began_ns, int(times[0])), min(ended_ns, int(times[-1]))
    if end <= start or 2 * (end - start) < ended_ns - began_ns:
        return ResourceUse(None, None, memory_max)
    edges = np.concatenate(([start], times[(times > start) & (times < end)], [end]))
    # Relative to the start of the window, because float64 cannot represent nanoseconds since boot.
    used = np.interp((edges - start) / 1e9, (times - start) / 1e9, rows["cpu_s"])
    apart = spaced_indices(edges)
    busiest = float(np.max(np.diff(used[apart]) / (np.diff(edges[apart]) / 1e9)))
    mean = float(used[-1] - used[0]) / ((end - start) / 1e9)
    waited_s = _growth(rows, "waited_s", start, end)
    return ResourceUse(
        mean,
        max(busiest, mean),
        memory_max,
        None if waited_s is None else waited_s / ((end - start) / 1e9),
        _growth(rows, "minor_faults", start, end),
    )


def _growth(rows: Rows, field: str, start: int, end: int) -> float | None:
    """By how much a cumulative value has grown; None if it is unknown at some sample."""
    values = rows[field]
    # -1 in files of versions that did not record it.
    if not np.all(values >= 0):
        return None
    times_s = (rows["time_ns"] - start) / 1e9
    first, last = np.interp([0.0, (end - start) / 1e9], times_s, values)
    return float(last - first)


def _sum(values: list[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) if known else None
