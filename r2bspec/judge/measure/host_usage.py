"""The use of the machine in an interval: by the processes of the run, and by others.

Processor time and memory of a process are its resource usage; the activity of other programs is
host interference.
"""

from __future__ import annotations

import math
import statistics
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.units import show
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


def spaced_indices(times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the indices of ascending times at least `MIN_SPACING_NS` apart.

    The last time is kept.
    """
    kept: list[int] = []
    index, last = 0, times_ns.size - 1
    # A column of a table is not contiguous, and would be copied by each search.
    times_ns = np.ascontiguousarray(times_ns)
    while index <= last:
        kept.append(index)
        # It goes on even where times that a file has do not ascend.
        index = max(index + 1, int(times_ns.searchsorted(times_ns[index] + MIN_SPACING_NS)))
    if kept and kept[-1] != last:
        kept[max(len(kept) - 1, 1) :] = [last]
    return np.array(kept, dtype=np.int64)


class ProcessSamples:
    """The samples of each process of a run, and of the machine.

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
        """Return the rows of one process in the order of time; none if it was not sampled."""
        place = self._places.get(index)
        return np.empty(0, RESOURCE_DTYPE) if place is None else self._rows[place]

    def count_windows(self, began_ns: NDArray[np.int64], ended_ns: NDArray[np.int64]) -> int:
        """Return an upper limit of how many uses `used` calculates in all windows together."""
        begun_before_end = np.searchsorted(np.sort(began_ns), self._last_ns)
        ended_before_begin = np.searchsorted(np.sort(ended_ns), self._first_ns, side="right")
        return int(np.maximum(begun_before_end - ended_before_begin, 0).sum())

    def used(self, began_ns: int, ended_ns: int) -> dict[int, ResourceUse]:
        """Return the use of each process between two times; see `used_in`."""
        return self.used_in(np.array([began_ns]), np.array([ended_ns]))[0]

    def used_in(
        self, began_ns: NDArray[np.int64], ended_ns: NDArray[np.int64]
    ) -> list[dict[int, ResourceUse]]:
        """Return the use of each process in each of some windows, by ascending index.

        With C(t) the processor time used up to t, interpolated linearly between samples,

            cpu_mean = (C(ended) - C(began)) / (ended - began)

        so that time outside the window does not count, whatever the sampling period. Samples must
        cover at least half of the window; the rest is left out of both differences. A process of
        which nothing was sampled then is left out.
        """
        used: list[dict[int, ResourceUse]] = [{} for _ in range(began_ns.size)]
        for index, windows, sampled in self.windows(began_ns, ended_ns):
            for window, use in zip(windows, _uses(sampled), strict=True):
                used[window][index] = use
        return used

    def windows(
        self, began_ns: NDArray[np.int64], ended_ns: NDArray[np.int64]
    ) -> Iterator[tuple[int, list[int], SampledWindows]]:
        """Yield the index of each process, and those of some windows in which it was sampled."""
        for index in self._indices.tolist():
            windows = self._windows_of(index, began_ns, ended_ns)
            if windows.size:
                ends = began_ns[windows], ended_ns[windows]
                yield index, windows.tolist(), SampledWindows(self.rows(index), *ends)

    def _windows_of(
        self, index: int, began_ns: NDArray[np.int64], ended_ns: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Return the windows in which a process was sampled."""
        place = self._places.get(index)
        if place is None or self._rows[place].size < 2:
            return np.empty(0, np.int64)
        sampled = (self._last_ns[place] > began_ns) & (self._first_ns[place] < ended_ns)
        return np.flatnonzero(sampled & (began_ns <= ended_ns))

    def used_together(
        self, indices: Sequence[int], began_ns: NDArray[np.int64], ended_ns: NDArray[np.int64]
    ) -> list[ResourceUse | None]:
        """Return the use of several processes in each of some windows, as if they were one process.

        Times of sampling differ a little between processes: the values of the others are
        interpolated at the times of the process with the most samples. So the maxima are maxima of
        sums, which sums of maxima are not.

        Returns:
            None where nothing was sampled of any of them.
        """
        sampled_in: list[list[int]] = [[] for _ in range(began_ns.size)]
        for index in indices:
            for window in self._windows_of(index, began_ns, ended_ns).tolist():
                sampled_in[window].append(index)
        windows_of: dict[tuple[int, ...], list[int]] = {}
        for window, those in enumerate(sampled_in):
            windows_of.setdefault(tuple(those), []).append(window)
        together: list[ResourceUse | None] = [None] * began_ns.size
        for those_sampled, windows in windows_of.items():
            if not those_sampled:
                continue
            began, ended = began_ns[windows], ended_ns[windows]
            ends = int(began.min()), int(ended.max())
            rows = _summed([_around(self.rows(index), *ends) for index in those_sampled])
            uses = _uses(SampledWindows(rows, began, ended))
            for window, use in zip(windows, uses, strict=True):
                together[window] = use
        return together


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
    """Return the common use of several processes, at least one, in a window."""
    if len(found) == 1:
        return found[0]
    # The busiest moments need not coincide: their sum is an upper bound.
    sums = {name: _sum(found, name) for name in ("cpu_mean", "cpu_max", "waited", "minor_faults")}
    return ResourceUse(memory_max_bytes=sum(one.memory_max_bytes or 0 for one in found), **sums)


class SampledWindows:
    """Some windows in the samples of one process, in each of which it was sampled.

    A run has thousands of windows: all are calculated at once. Samples must cover at least half of
    a window; the rest of it is left out.

    Args:
        rows: of the process, in the order of time.
        began_ns: the beginnings of the windows.
        ended_ns: their ends.

    Attributes:
        has_sample: whether a sample is inside of each.
    """

    def __init__(
        self, rows: Rows, began_ns: NDArray[np.int64], ended_ns: NDArray[np.int64]
    ) -> None:
        self._rows = rows = _around(rows, int(began_ns.min()), int(ended_ns.max()))
        self._times = times = np.ascontiguousarray(rows["time_ns"])
        self._since = np.searchsorted(times, began_ns)
        self._until = np.searchsorted(times, ended_ns, side="right")
        self.has_sample: NDArray[np.bool_] = self._since < self._until
        self._before = np.maximum(self._since - 1, 0)
        self._after = np.minimum(self._until, times.size - 1)
        self._start = start = np.maximum(began_ns, times[self._before])
        self._end = end = np.minimum(ended_ns, times[self._after])
        self._covered = (end > start) & (2.0 * (end - start) >= ended_ns - began_ns)
        self._seconds = np.where(self._covered, (end - start) / 1e9, 1.0)

    def growth(self, field: str) -> NDArray[np.float64]:
        """Return the growth of a counter in each window; NaN where it is not known.

        Between two samples it is interpolated linearly.
        """
        values = self._rows[field]
        # Relative to the first sample, because float64 cannot represent nanoseconds since boot.
        times_s, start_s, end_s = (
            (each - self._times[0]) / 1e9 for each in (self._times, self._start, self._end)
        )
        grown: NDArray[np.float64] = np.interp(end_s, times_s, values)
        grown -= np.interp(start_s, times_s, values)
        # -1 in files of versions that did not record it.
        missing = np.concatenate(([0], np.cumsum(~(values >= 0))))
        is_missing = missing[self._after + 1] != missing[self._before]
        grown[is_missing | ~self._covered] = math.nan
        return grown

    def mean(self, field: str) -> NDArray[np.float64]:
        """Return the growth of a counter per second."""
        return self.growth(field) / self._seconds

    def most(self, field: str) -> NDArray[np.float64]:
        """Return the largest growth per second between samples at least `MIN_SPACING_NS` apart."""
        times, start, end, used = self._times, self._start, self._end, self._rows[field]
        first, past = np.searchsorted(times, start, side="right"), np.searchsorted(times, end)
        gaps = times[1:] - times[:-1]
        near = np.concatenate(([0], np.cumsum(gaps < MIN_SPACING_NS)))
        times_s = (times - times[0]) / 1e9
        crowded = (
            self._covered
            & (past > first)
            & (near[np.maximum(past - 1, 0)] > near[np.minimum(first, times.size - 1)])
        )
        # Of the others, only samples next to an end of the window are too near to it.
        past_last = past - (end - times[np.maximum(past - 1, 0)] < MIN_SPACING_NS)
        first = first + (times[np.minimum(first, times.size - 1)] - start < MIN_SPACING_NS)
        some = first < past_last
        ends = np.interp([(start - times[0]) / 1e9, (end - times[0]) / 1e9], times_s, used)
        low, high = np.minimum(first, times.size - 1), np.maximum(past_last - 1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            inside = _largest((used[1:] - used[:-1]) / (gaps / 1e9), low, high)
            at_start = (used[low] - ends[0]) / ((times[low] - start) / 1e9)
            at_end = (ends[1] - used[high]) / ((end - times[high]) / 1e9)
            whole = (ends[1] - ends[0]) / ((end - start) / 1e9)
        inside = np.where(low < high, inside, -math.inf)
        largest = np.where(some, np.maximum(np.maximum(at_start, at_end), inside), whole)
        for window in np.flatnonzero(crowded).tolist():
            after = np.searchsorted(times, start[window], side="right")
            within = times[after : past[window]]
            edges = np.concatenate((start[window : window + 1], within, end[window : window + 1]))
            edges = edges[spaced_indices(edges)]
            grown = np.diff(np.interp((edges - times[0]) / 1e9, times_s, used))
            largest[window] = (grown / (np.diff(edges) / 1e9)).max()
        return np.asarray(np.fmax(self.mean(field), largest))

    def largest(self, field: str) -> NDArray[Any]:
        """Return the largest value of a sample; anything in a window without."""
        return _largest(self._rows[field], self._since, self._until)


def _uses(sampled: SampledWindows) -> list[ResourceUse]:
    """Return what one process used in some windows."""
    columns = (
        sampled.mean("cpu_s"),
        sampled.most("cpu_s"),
        sampled.has_sample,
        sampled.largest("memory_bytes"),
        sampled.mean("waited_s"),
        sampled.growth("minor_faults"),
    )
    return [
        ResourceUse(
            cpu_mean=_finite(mean),
            cpu_max=None if math.isnan(mean) else most,
            memory_max_bytes=memory if has_sample else None,
            waited=_finite(waited),
            minor_faults=_finite(faults),
        )
        for mean, most, has_sample, memory, waited, faults in zip(
            *(column.tolist() for column in columns), strict=True
        )
    ]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _largest(
    values: NDArray[Any], first: NDArray[np.int64], past: NDArray[np.int64]
) -> NDArray[Any]:
    """Return the largest of ``values[first:past]`` for each of some parts.

    Anything for an empty one.
    """
    ends = np.column_stack((first, np.maximum(first, past))).ravel()
    return np.maximum.reduceat(np.append(values, np.zeros(2, values.dtype)), ends)[::2]


def _around(rows: Rows, began_ns: int, ended_ns: int) -> Rows:
    """Rows inside a window and one on each side."""
    # Not numpy's search: it copies a field of an array of structures, all of it, for each window.
    first = bisect_left(rows["time_ns"], began_ns) - 1
    last = bisect_right(rows["time_ns"], ended_ns)
    return rows[max(first, 0) : last + 1]


def _known(found: Iterable[ResourceUse], name: str) -> list[Any]:
    """Return the values of a field that are known."""
    return [value for one in found if (value := getattr(one, name)) is not None]


def _sum(found: Iterable[ResourceUse], name: str) -> float | None:
    known = _known(found, name)
    return sum(known) if known else None


def pool_resource_use(samples: Iterable[ResourceUse | None]) -> ResourceUse | None:
    """Return the mean of the means, the largest of the maxima, the sum of the counts.

    None without any.
    """
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


@dataclass(frozen=True)
class DeviceUse:
    """The use of GPUs and processor packages in a window, by the counters of `DEVICE_FIELDS`.

    Attributes:
        mean: the growth of a counter per time.
        most: the largest of the same between two samples at least `MIN_SPACING_NS` apart.
        per_step: the growth for each step of the segment.
        gpu_bytes: the largest GPU memory in use at a sample; None if it is unknown.
    """

    mean: dict[str, float]
    most: dict[str, float]
    per_step: dict[str, float]
    gpu_bytes: float | None


_COUNTERS: Final = ("busy_s", "encoder_s", "decoder_s", "gpu_j", "package_j")


def device_use(
    rows: Rows, began_ns: NDArray[np.int64], ended_ns: NDArray[np.int64], steps: Sequence[int]
) -> list[dict[int, DeviceUse]]:
    """Return the use of devices in some windows, by the machine and by processes on a GPU.

    A value that is unknown at any sample of a window is unknown in the window.

    Args:
        rows: of type `DEVICE_DTYPE`.
        began_ns: the beginnings of the windows.
        ended_ns: their ends.
        steps: the number of steps in each window.
    """
    found: list[dict[int, DeviceUse]] = [{} for _ in steps]
    for index, windows, sampled in ProcessSamples(rows).windows(began_ns, ended_ns):
        figures = zip(
            windows,
            np.transpose([sampled.mean(counter) for counter in _COUNTERS]).tolist(),
            np.transpose([sampled.most(counter) for counter in _COUNTERS]).tolist(),
            np.where(sampled.has_sample, sampled.largest("gpu_bytes"), math.nan).tolist(),
            strict=True,
        )
        for window, means, most, memory in figures:
            known = [number for number, mean in enumerate(means) if math.isfinite(mean)]
            mean = {_COUNTERS[number]: means[number] for number in known}
            seconds = float(ended_ns[window] - began_ns[window]) / 1e9
            found[window][index] = DeviceUse(
                mean=mean,
                most={_COUNTERS[number]: most[number] for number in known},
                per_step={name: one * seconds / steps[window] for name, one in mean.items()}
                if steps[window]
                else {},
                gpu_bytes=_finite(memory),
            )
    return found


def pool_device_use(samples: Sequence[DeviceUse]) -> DeviceUse:
    """Return the means of the means, and the largest maxima; None where any sample has None."""

    def pool(name: str, of: Callable[[list[float]], float]) -> dict[str, float]:
        known = [getattr(sample, name) for sample in samples]
        common = [key for key in known[0] if all(key in one for one in known)]
        return {key: of([one[key] for one in known]) for key in common}

    memory = [sample.gpu_bytes for sample in samples]
    return DeviceUse(
        mean=pool("mean", statistics.fmean),
        most=pool("most", max),
        per_step=pool("per_step", statistics.fmean),
        gpu_bytes=None if None in memory else max(filter(None, memory), default=0.0),
    )


class HostInterference(msgspec.Struct, frozen=True, kw_only=True):
    """Host interference during one iteration; None if unknown.

    Attributes:
        seconds: how long the iteration lasted.
        cores: processors that the run may use.
        threads_per_core: hardware threads that share a core.
        steal: the share of their time that other virtual machines got.
        foreign_cores: processor time per time that processes outside the run used on them.
        pressure: share of the time in which some task waited for a processor (PSI, ``some``).
        throttled_s: time for which a processor or the control group was throttled.
        frequency_hz: of the processors while they were in use, on average.
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
    own_cores: float | None = None
    own_waited: float | None = None


def host_interference(
    rows: Rows,
    used: Sequence[Mapping[int, ResourceUse]],
    processes: Container[int],
    machine: Mapping[str, Any],
    began_ns: NDArray[np.int64],
    ended_ns: NDArray[np.int64],
) -> list[HostInterference | None]:
    """Return the interference in each of some windows, interpolated linearly between samples.

    Args:
        rows: of type `INTERFERENCE_DTYPE`, in order of time.
        used: see `ProcessSamples.used_in`.
        processes: the indices of all processes of the run.
        machine: as in `RunRecord.machine`.
        began_ns: the beginnings of the windows.
        ended_ns: their ends.

    Returns:
        None where the samples do not cover half of the window.
    """
    if rows.size < 2:
        return [None] * began_ns.size
    times = np.ascontiguousarray(rows["time_ns"])
    # Relative to the first sample, as for a process.
    times_s, began_s, ended_s = ((each - times[0]) / 1e9 for each in (times, began_ns, ended_ns))
    inside_ns = np.minimum(ended_ns, times[-1]) - np.maximum(began_ns, times[0])
    covered = (ended_ns > began_ns) & (2.0 * inside_ns >= ended_ns - began_ns)
    sums = np.array(
        [
            np.interp(ended_s, times_s, rows[field]) - np.interp(began_s, times_s, rows[field])
            for field in ("stolen_s", "waited_s", "busy_s", "cycles", "throttled_s")
        ]
    )
    return [
        _interference(growths, of_window, processes, machine, seconds) if known else None
        for growths, of_window, seconds, known in zip(
            sums.T.tolist(), used, ((ended_ns - began_ns) / 1e9).tolist(), covered, strict=True
        )
    ]


def _interference(
    growths: Sequence[float],
    used: Mapping[int, ResourceUse],
    processes: Container[int],
    machine: Mapping[str, Any],
    seconds: float,
) -> HostInterference:
    """The same in one window, from the growth of each sum, which is NaN where nothing counts it."""
    stolen_s, waited_s, busy_s, cycles, throttled_s = (
        max(0.0, growth) if math.isfinite(growth) else None for growth in growths
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


def _foreign_cores(
    busy_s: float | None, own: ResourceUse | None, controller: ResourceUse | None, seconds: float
) -> float | None:
    if busy_s is None or own is None or own.cpu_mean is None:
        return None
    known = own.cpu_mean + ((controller.cpu_mean or 0.0) if controller is not None else 0.0)
    return max(0.0, busy_s / seconds - known)


_MAX_STEAL_SHARE = 0.01
_MAX_FOREIGN_SHARE = 0.1
_MAX_FOREIGN_CORES = 0.5
_MAX_THROTTLED_SHARE = 0.01


MAX_TAKEN_SHARE: Final = 0.75
"""A machine on which everything takes over four times as long keeps no schedule either."""

_SHARED_PROCESSOR_LOSS = 0.5


def taken_share(known: HostInterference | None) -> float:
    """Return the largest share of the time that others can have taken from the run.

    Its threads could run but did not (`own_waited`), no longer than tasks waited for a processor at
    all (`pressure`) and others used processors. Stolen and throttled time is added, and where two
    hardware threads share a core, half of the time in which another program ran beside the run.
    """
    if known is None:
        return 0.0
    bounds = (known.own_waited, known.pressure, known.foreign_cores)
    taken = min((bound for bound in bounds if bound is not None), default=0.0)
    taken += (known.steal or 0.0) * (known.cores or 1)
    taken += (known.throttled_s or 0.0) / known.seconds if known.seconds else 0.0
    if (known.threads_per_core or 1) > 1:
        taken += _SHARED_PROCESSOR_LOSS * min(known.own_cores or 0.0, known.foreign_cores or 0.0)
    return min(MAX_TAKEN_SHARE, taken)


def interference_reasons(one: HostInterference | None) -> tuple[str, ...]:
    """Return in words the host interference that affected a part of a run; empty for none.

    On a shared machine other programs take the processor, the hypervisor takes it away (steal), and
    it is throttled because of heat. An iteration is affected if one of these is known of it:

        steal          over 1 % of the time of all cores was given to other virtual machines
        foreign load   processes outside the benchmark used more than a tenth of all cores, and
                       more than half a core
        throttling     the kernel reports that a processor was throttled, or the control group ran
                       out of its quota, for over 1 % of the time

    Args:
        one: what is known of it.
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
    if one.throttled_s is not None and one.throttled_s > _MAX_THROTTLED_SHARE * one.seconds:
        reasons.append(
            f"processors were throttled for {show(one.throttled_s, 's')} "
            f"(limit {show(_MAX_THROTTLED_SHARE * one.seconds, 's')})"
        )
    return tuple(reasons)
