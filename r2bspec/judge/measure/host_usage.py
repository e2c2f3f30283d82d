"""What was used of the machine during an interval: by the processes of the run, and by others.

Processor time and memory of a process are its resource usage; what else happened on the machine is
host interference.
"""

from __future__ import annotations

import math
import statistics
from bisect import bisect_left, bisect_right
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.units import show
from r2bspec.record.run_record import HarnessOverheadRecord
from r2bspec.record.sample_arrays import RESOURCE_DTYPE, Rows


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


_CROWDED = 100
"""Times for each that is kept, from which on a search for the next is faster than a loop."""


def spaced_indices(times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """The indices of ascending times at least `MIN_SPACING_NS` apart; the last one is kept."""
    kept: list[int] = []
    index, next_ns = 0, 0
    if times_ns.size > _CROWDED and times_ns.size > _CROWDED * (
        (int(times_ns[-1]) - int(times_ns[0])) // MIN_SPACING_NS + 1
    ):
        times_ns = np.ascontiguousarray(times_ns)
        while index < times_ns.size:
            kept.append(index)
            index = int(np.searchsorted(times_ns, times_ns[index] + MIN_SPACING_NS))
    else:
        for index, time_ns in enumerate(times_ns.tolist()):
            if not kept or time_ns >= next_ns:
                kept.append(index)
                next_ns = time_ns + MIN_SPACING_NS
    if kept and kept[-1] != times_ns.size - 1:
        kept[-1:] = [times_ns.size - 1] if len(kept) > 1 else [kept[-1], times_ns.size - 1]
    return np.array(kept, dtype=np.int64)


class ProcessSamples:
    """What was sampled of each process of a run, and of the machine.

    Args:
        resources: rows of type `RESOURCE_DTYPE`, in any order.
    """

    def __init__(self, resources: Rows) -> None:
        ordered = resources[np.lexsort((resources["time_ns"], resources["process"]))]
        self._indices, starts = np.unique(ordered["process"], return_index=True)
        self._rows = np.split(ordered, starts[1:])
        self._places = {index: place for place, index in enumerate(self._indices.tolist())}
        ends = np.append(starts, ordered.size)[1:]
        self._first_ns = ordered["time_ns"][starts]
        self._last_ns = ordered["time_ns"][ends - 1]

    def rows(self, index: int) -> Rows:
        """The rows of one process in the order of time; none if it was not sampled."""
        place = self._places.get(index)
        return np.empty(0, RESOURCE_DTYPE) if place is None else self._rows[place]

    def count_windows(self, began_ns: NDArray[np.int64], ended_ns: NDArray[np.int64]) -> int:
        """How many uses `used` calculates in all windows together, at most."""
        begun_before_end = np.searchsorted(np.sort(began_ns), self._last_ns)
        ended_before_begin = np.searchsorted(np.sort(ended_ns), self._first_ns, side="right")
        return int(np.maximum(begun_before_end - ended_before_begin, 0).sum())

    def used(self, began_ns: int, ended_ns: int) -> dict[int, ResourceUse]:
        """What each process used between two times, by its index, ascending.

        With C(t) the processor time used up to t, interpolated linearly between samples,

            cpu_mean = (C(ended) - C(began)) / (ended - began)

        so that time outside the window does not count, whatever the sampling period. Samples must
        cover at least half of the window; the rest is left out of both differences. A process of
        which nothing was sampled then is left out.
        """
        # A run has thousands of windows, and the processes of all its starts.
        sampled = (self._last_ns > began_ns) & (self._first_ns < ended_ns)
        if ended_ns < began_ns:
            return {}
        return {
            int(self._indices[place]): _process_use(self._rows[place], began_ns, ended_ns)
            for place in np.flatnonzero(sampled)
            if self._rows[place].size > 1
        }

    def used_together(
        self, indices: Iterable[int], began_ns: int, ended_ns: int
    ) -> ResourceUse | None:
        """What several processes used between two times, as if they were one.

        Times of sampling differ by little from process to process: at those of the one that was
        sampled most often, the values of the others are interpolated. So the maxima are those of
        sums, which the sums of maxima are not.

        Returns:
            None if nothing was sampled of any of them then.
        """
        found = [
            _around(rows, began_ns, ended_ns)
            for index in indices
            if (rows := self.rows(index)).size > 1
            and rows["time_ns"][0] < ended_ns
            and rows["time_ns"][-1] > began_ns
        ]
        return _process_use(_summed(found), began_ns, ended_ns) if found else None


def _summed(found: Sequence[Rows]) -> Rows:
    """One row for each sample of the process that was sampled most often."""
    if len(found) == 1:
        return found[0]
    total = max(found, key=len).copy()
    times = total["time_ns"]
    since = times[0]
    for field in ("cpu_s", "memory_bytes", "waited_s", "minor_faults"):
        # -1 in files of versions that did not record it.
        known = all(rows[field].min() >= 0 for rows in found)
        total[field] = -1
        if known:
            total[field] = sum(
                np.interp((times - since) / 1e9, (rows["time_ns"] - since) / 1e9, rows[field])
                for rows in found
            )
    return total


def total_use(found: Sequence[ResourceUse]) -> ResourceUse:
    """What several processes, at least one, used together in one window."""
    if len(found) == 1:
        return found[0]
    # The busiest moments need not coincide: their sum is an upper bound.
    sums = {name: _sum(found, name) for name in ("cpu_mean", "cpu_max", "waited", "minor_faults")}
    return ResourceUse(memory_max_bytes=sum(one.memory_max_bytes or 0 for one in found), **sums)


def _process_use(rows: Rows, began_ns: int, ended_ns: int) -> ResourceUse:
    """The use of one process, of which there are samples on both sides of some time in between."""
    rows = _around(rows, began_ns, ended_ns)
    times = rows["time_ns"]
    memory = rows["memory_bytes"][bisect_left(times, began_ns) : bisect_right(times, ended_ns)]
    memory_max = int(memory.max()) if memory.size else None
    start, end = max(began_ns, int(times[0])), min(ended_ns, int(times[-1]))
    if end <= start or 2 * (end - start) < ended_ns - began_ns:
        return ResourceUse(None, None, memory_max)
    within = times[bisect_right(times, start) : bisect_left(times, end)]
    edges = np.concatenate(([start], within, [end]))
    # Relative to the start of the window, because float64 cannot represent nanoseconds since boot.
    times_s, edges_s, seconds = (times - start) / 1e9, (edges - start) / 1e9, (end - start) / 1e9
    used = np.interp(edges_s, times_s, rows["cpu_s"])
    apart = spaced_indices(edges)
    # Not by numpy's diff: a run has thousands of windows.
    some_used, some_edges = used[apart], edges[apart]
    growth, between = some_used[1:] - some_used[:-1], some_edges[1:] - some_edges[:-1]
    busiest = float((growth / (between / 1e9)).max())
    mean = float(used[-1] - used[0]) / seconds
    waited_s, minor_faults = (
        # -1 in files of versions that did not record it.
        _growth(times_s, rows[field], seconds) if rows[field].min() >= 0 else None
        for field in ("waited_s", "minor_faults")
    )
    return ResourceUse(
        mean,
        max(busiest, mean),
        memory_max,
        None if waited_s is None else waited_s / seconds,
        minor_faults,
    )


def _around(rows: Rows, began_ns: int, ended_ns: int) -> Rows:
    """Rows inside a window and one on each side."""
    # Not numpy's search: it copies a field of an array of structures, all of it, for each window.
    first = bisect_left(rows["time_ns"], began_ns) - 1
    last = bisect_right(rows["time_ns"], ended_ns)
    return rows[max(first, 0) : last + 1]


def _growth(times_s: NDArray[np.float64], values: NDArray[np.float64], seconds: float) -> float:
    """By how much a cumulative value has grown from 0 on; NaN where it is not reported."""
    first, last = np.interp((0.0, seconds), times_s, values)
    return float(last - first)


def _known(found: Iterable[ResourceUse], name: str) -> list[Any]:
    """The values of a field that are known."""
    return [value for one in found if (value := getattr(one, name)) is not None]


def _sum(found: Iterable[ResourceUse], name: str) -> float | None:
    known = _known(found, name)
    return sum(known) if known else None


_MIN_LATENCY_DIFFERENCE_NS = 100_000


def pool_resource_use(samples: Iterable[ResourceUse | None]) -> ResourceUse | None:
    """The mean of the means, the largest of the maxima, the sum of the counts; None without any."""
    known = [sample for sample in samples if sample is not None]
    if not known:
        return None
    means = _known(known, "cpu_mean")
    return ResourceUse(
        cpu_mean=sum(means) / len(means) if means else None,
        cpu_max=max(_known(known, "cpu_max"), default=None),
        memory_max_bytes=max(_known(known, "memory_max_bytes"), default=None),
        minor_faults=_sum(known, "minor_faults"),
    )


class HostInterference(msgspec.Struct, frozen=True, kw_only=True):
    """Host interference during one iteration; None is unknown.

    Attributes:
        seconds: how long the iteration lasted.
        cores: processors that the run may use.
        threads_per_core: hardware threads that share a core.
        steal: the share of their time that other virtual machines got.
        foreign_cores: processor time per time that processes outside the run used on them.
        pressure: share of the time in which some task waited for a processor (PSI, ``some``).
        throttled_s: time for which a processor or the control group was throttled.
        frequency_hz: of the processors while they were in use, on average.
        calibration: latency of the harness alone, relative to its usual latency here.
        own_cores: processor time per time that the run used itself.
        own_waited: run-queue wait of all threads of the run per time; over 1 if several wait.
    """

    seconds: float = 0.0
    cores: int | None = None
    threads_per_core: int | None = None
    steal: float | None = None
    foreign_cores: float | None = None
    pressure: float | None = None
    throttled_s: float | None = None
    frequency_hz: float | None = None
    calibration: float | None = None
    own_cores: float | None = None
    own_waited: float | None = None


def host_interference(
    rows: Rows,
    used: Mapping[int, ResourceUse],
    processes: Container[int],
    machine: Mapping[str, Any],
    began_ns: int,
    ended_ns: int,
) -> HostInterference | None:
    """The interference between two times, interpolated linearly between samples.

    Args:
        rows: of type `INTERFERENCE_DTYPE`, in order of time.
        used: see `ProcessSamples.used`.
        processes: the indices of all processes of the run.
        machine: as in `RunRecord.machine`.
        began_ns: the beginning of the window.
        ended_ns: its end.

    Returns:
        None if the samples do not cover the window.
    """
    seconds = (ended_ns - began_ns) / 1e9
    if seconds <= 0 or not _covers(rows, began_ns, ended_ns):
        return None
    rows = _around(rows, began_ns, ended_ns)
    # Relative to the start of the window, as for a process.
    times_s = (rows["time_ns"] - began_ns) / 1e9
    stolen_s, waited_s, busy_s, cycles, throttled_s = (
        _growth_on_host(times_s, rows[field], seconds)
        for field in ("stolen_s", "waited_s", "busy_s", "cycles", "throttled_s")
    )
    of_run = [use for index, use in used.items() if index == ORPHANS_INDEX or index in processes]
    own = total_use(of_run) if of_run else None
    cores = machine.get("cores")
    return HostInterference(
        seconds=seconds,
        cores=cores,
        threads_per_core=machine.get("threads_per_core"),
        steal=None if stolen_s is None or not cores else min(1.0, stolen_s / (seconds * cores)),
        foreign_cores=_foreign_cores(busy_s, own, used.get(CONTROLLER_INDEX), seconds),
        pressure=None if waited_s is None else min(1.0, waited_s / seconds),
        throttled_s=throttled_s,
        frequency_hz=cycles / busy_s if cycles and busy_s else None,
        own_cores=own.cpu_mean if own is not None else None,
        own_waited=own.waited if own is not None else None,
    )


def _covers(rows: Rows, began_ns: int, ended_ns: int) -> bool:
    """Whether samples cover at least half of a window."""
    if rows.size < 2:
        return False
    inside = min(ended_ns, int(rows["time_ns"][-1])) - max(began_ns, int(rows["time_ns"][0]))
    return 2 * inside >= ended_ns - began_ns


def _growth_on_host(
    times_s: NDArray[np.float64], values: NDArray[np.float64], seconds: float
) -> float | None:
    """By how much a sum grew; None if the system does not report it."""
    grown = _growth(times_s, values, seconds)
    return max(0.0, grown) if math.isfinite(grown) else None


def _foreign_cores(
    busy_s: float | None, own: ResourceUse | None, controller: ResourceUse | None, seconds: float
) -> float | None:
    if busy_s is None or own is None or own.cpu_mean is None:
        return None
    known = own.cpu_mean + ((controller.cpu_mean or 0.0) if controller is not None else 0.0)
    return max(0.0, busy_s / seconds - known)


def harness_slowdown(
    usual: tuple[HarnessOverheadRecord, ...], now: tuple[HarnessOverheadRecord, ...]
) -> float | None:
    """The latency of the harness alone over its usual one: the largest ratio of the inputs.

    Medians of the same input are compared. A difference below `_MIN_LATENCY_DIFFERENCE_NS` is
    caused by the timer and the scheduler, whatever the ratio.

    Returns:
        None if the harness overhead of no input is in both.
    """
    before = {(overhead.topic, overhead.rate_hz): overhead.latency_p50_ns for overhead in usual}
    ratios = [
        overhead.latency_p50_ns / known
        if overhead.latency_p50_ns - known > _MIN_LATENCY_DIFFERENCE_NS
        else 1.0
        for overhead in now
        if overhead.latency_p50_ns and (known := before.get((overhead.topic, overhead.rate_hz)))
    ]
    return max(ratios, default=None)


_MAX_STEAL_SHARE = 0.01
_MAX_FOREIGN_SHARE = 0.1
_MAX_FOREIGN_CORES = 0.5
_MAX_PRESSURE = 0.1
_MAX_PRESSURE_RATIO = 2.0
_MAX_THROTTLED_SHARE = 0.01
_MAX_SLOWDOWN = 1.5


def median_pressure(interference: Sequence[HostInterference | None]) -> float:
    """The pressure in the median iteration, to which the others are compared."""
    pressures = [
        sample.pressure for sample in interference if sample and sample.pressure is not None
    ]
    return statistics.median(pressures) if pressures else 0.0


def interference_reasons(one: HostInterference | None, usual: float) -> tuple[str, ...]:
    """Which host interference affected an iteration, in words; empty for none.

    On a shared machine other programs take the processor, the hypervisor takes it away (steal), and
    it is throttled because of heat. An iteration is affected if one of these is known of it:

        steal          over 1 % of the time of all cores was given to other virtual machines
        foreign load   processes outside the benchmark used more than a tenth of all cores, and
                       more than half a core
        pressure       tasks waited for a processor for over 10 % of the time, and more than twice
                       as long as in the median iteration: a graph with more threads than cores
                       makes pressure of its own, but the same in each iteration
        throttling     the kernel reports that a processor was throttled, or the control group ran
                       out of its quota, for over 1 % of the time
        calibration    the harness alone, with no graph between player and monitor, took over 1.5
                       times as long as it usually does

    Args:
        one: its host interference.
        usual: the `median_pressure` at its rate.
    """
    if one is None:
        return ()
    reasons: list[str] = []
    if one.steal is not None and one.steal > _MAX_STEAL_SHARE:
        reasons.append(
            f"{show(one.steal, 'share')} of the processor time was stolen by other virtual machines"
            f" (limit {show(_MAX_STEAL_SHARE, 'share')})"
        )
    if one.foreign_cores is not None:
        least = max(_MAX_FOREIGN_CORES, _MAX_FOREIGN_SHARE * (one.cores or 0))
        if one.foreign_cores > least:
            used = (
                f"{one.foreign_cores:.2g} of {one.cores}"
                if one.cores
                else f"{one.foreign_cores:.2g}"
            )
            reasons.append(f"other processes used {used} cores (limit {least:.2g})")
    most = max(_MAX_PRESSURE, _MAX_PRESSURE_RATIO * usual)
    if one.pressure is not None and one.pressure > most:
        reasons.append(
            f"tasks waited for a processor {show(one.pressure, 'share')} of the time "
            f"(limit {show(most, 'share')})"
        )
    if one.throttled_s is not None and one.throttled_s > _MAX_THROTTLED_SHARE * one.seconds:
        reasons.append(
            f"processors were throttled for {show(one.throttled_s, 's')} "
            f"(limit {show(_MAX_THROTTLED_SHARE * one.seconds, 's')})"
        )
    if one.calibration is not None and one.calibration > _MAX_SLOWDOWN:
        reasons.append(
            f"the harness alone took {one.calibration:.2g} times as long as before "
            f"(limit {_MAX_SLOWDOWN:g})"
        )
    return tuple(reasons)
