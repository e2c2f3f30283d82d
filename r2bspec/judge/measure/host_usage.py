"""The use of the machine in an interval: by the processes of the run, and by others.

Processor time and memory of a process are its resource usage; the activity of other programs is
host interference.
"""

from __future__ import annotations

import math
import statistics
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
    """

    cpu_mean: float | None
    cpu_max: float | None
    memory_max_bytes: int | None
    waited: float | None = None


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
        self._rows = {
            index: ordered[ordered["process"] == index]
            for index in np.unique(ordered["process"]).tolist()
        }

    def rows(self, index: int) -> Rows:
        """Return the rows of one process in the order of time; none if it was not sampled."""
        rows: Rows = self._rows.get(index, np.empty(0, RESOURCE_DTYPE))
        return rows

    def sampled(self, began_ns: int, ended_ns: int) -> Iterator[tuple[int, SampledWindow]]:
        """Yield the index of each process that was sampled between two times, and its samples."""
        for index, rows in self._rows.items():
            times = rows["time_ns"]
            overlap = rows.size > 1 and times[-1] > began_ns and times[0] < ended_ns
            if overlap and began_ns <= ended_ns:
                yield index, SampledWindow(rows, began_ns, ended_ns)

    def used(self, began_ns: int, ended_ns: int) -> dict[int, ResourceUse]:
        """Return the use of each process between two times, by ascending index.

        With C(t) the processor time used up to t, interpolated linearly between samples,

            cpu_mean = (C(ended) - C(began)) / (ended - began)

        so that time outside the window does not count, whatever the sampling period. Samples must
        cover at least half of the window; the rest is left out of both differences. A process of
        which nothing was sampled then is left out.
        """
        return {index: _use(window) for index, window in self.sampled(began_ns, ended_ns)}

    def used_together(
        self, indices: Container[int], began_ns: int, ended_ns: int
    ) -> ResourceUse | None:
        """Return the use of several processes between two times, as if they were one process.

        Times of sampling differ a little between processes: the values of the others are
        interpolated at the times of the process with the most samples. So the maxima are maxima of
        sums, which sums of maxima are not.

        Returns:
            None where nothing was sampled of any of them.
        """
        sampled = self.sampled(began_ns, ended_ns)
        found = [window.rows for index, window in sampled if index in indices]
        return _use(SampledWindow(_summed(found), began_ns, ended_ns)) if found else None


def _summed(found: Sequence[Rows]) -> Rows:
    """Return one row for each sample of the process that was sampled most often."""
    if len(found) == 1:
        return found[0]
    total = max(found, key=len).copy()
    times = total["time_ns"]
    since = times[0]
    for field in ("cpu_s", "memory_bytes", "waited_s"):
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
    sums = {name: _sum(found, name) for name in ("cpu_mean", "cpu_max", "waited")}
    return ResourceUse(memory_max_bytes=sum(one.memory_max_bytes or 0 for one in found), **sums)


class SampledWindow:
    """The samples of one process in a window, and one on each side of it.

    Samples must cover at least half of the window; the rest of it is left out.

    Args:
        rows: the rows of the process, in the order of time.
        began_ns: the beginning of the window.
        ended_ns: its end.
    """

    def __init__(self, rows: Rows, began_ns: int, ended_ns: int) -> None:
        times = np.ascontiguousarray(rows["time_ns"])
        first, last = np.searchsorted(times, began_ns), np.searchsorted(times, ended_ns, "right")
        self.rows = rows[max(int(first) - 1, 0) : last + 1]
        self._inside = rows[first:last]
        # Relative to the first sample, because float64 cannot represent nanoseconds since boot.
        self._times = self.rows["time_ns"]
        self._origin_ns = int(self._times[0])
        start, end = max(began_ns, int(self._times[0])), min(ended_ns, int(self._times[-1]))
        edges = np.concatenate(([start], self._inside["time_ns"], [end]))
        self._edges = edges[spaced_indices(edges)]
        self._covered = end > start and 2 * (end - start) >= ended_ns - began_ns

    def _growths(self, field: str, edges_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return how much a counter grew between times, interpolated linearly between samples."""
        times, edges = ((each - self._origin_ns) / 1e9 for each in (self._times, edges_ns))
        return np.diff(np.interp(edges, times, self.rows[field]))

    def growth(self, field: str) -> float | None:
        """Return the growth of a counter in the window; None where it is not known."""
        known = self._covered and bool((self.rows[field] >= 0).all())
        return float(self._growths(field, self._edges[[0, -1]])[0]) if known else None

    def mean(self, field: str) -> float | None:
        """Return the growth of a counter per second."""
        grown, length_ns = self.growth(field), int(self._edges[-1] - self._edges[0])
        return None if grown is None else grown / (length_ns / 1e9)

    def most(self, field: str) -> float | None:
        """Return the largest growth per second between samples at least `MIN_SPACING_NS` apart."""
        mean = self.mean(field)
        if mean is None:
            return None
        rates = self._growths(field, self._edges) / (np.diff(self._edges) / 1e9)
        return max(mean, float(rates.max()))

    def largest(self, field: str) -> Any:
        """Return the largest value of a sample in the window; None without a sample."""
        return self._inside[field].max().item() if self._inside.size else None


def _use(window: SampledWindow) -> ResourceUse:
    """Return what a process used in a window."""
    return ResourceUse(
        cpu_mean=window.mean("cpu_s"),
        cpu_max=window.most("cpu_s"),
        memory_max_bytes=window.largest("memory_bytes"),
        waited=window.mean("waited_s"),
    )


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
    sampled: ProcessSamples, began_ns: int, ended_ns: int, steps: int
) -> dict[int, DeviceUse]:
    """Return the use of devices in a window, by the machine and by processes on a GPU.

    A value that is unknown at any sample of the window is unknown in it.

    Args:
        sampled: rows of type `DEVICE_DTYPE`.
        began_ns: the beginning of the window.
        ended_ns: its end.
        steps: the number of steps in it.
    """
    seconds = (ended_ns - began_ns) / 1e9

    def known(of: Callable[[str], float | None]) -> dict[str, float]:
        values = ((name, of(name)) for name in _COUNTERS)
        return {name: value for name, value in values if value is not None}

    found: dict[int, DeviceUse] = {}
    for index, window in sampled.sampled(began_ns, ended_ns):
        mean, memory = known(window.mean), window.largest("gpu_bytes")
        found[index] = DeviceUse(
            mean=mean,
            most=known(window.most),
            per_step={name: one * seconds / steps for name, one in mean.items()} if steps else {},
            gpu_bytes=memory if memory is not None and math.isfinite(memory) else None,
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
    used: Mapping[int, ResourceUse],
    processes: Container[int],
    machine: Mapping[str, Any],
    window_ns: tuple[int, int],
) -> HostInterference | None:
    """Return the interference in a window, interpolated linearly between samples.

    Args:
        rows: of type `INTERFERENCE_DTYPE`, in order of time.
        used: what processes used in the window; see `ProcessSamples.used`.
        processes: the indices of all processes of the run.
        machine: as in `RunRecord.machine`.
        window_ns: its beginning and its end.

    Returns:
        None where the samples do not cover half of the window.
    """
    began_ns, ended_ns = window_ns
    if rows.size < 2:
        return None
    times, seconds = rows["time_ns"], (ended_ns - began_ns) / 1e9
    inside_ns = min(ended_ns, int(times[-1])) - max(began_ns, int(times[0]))
    if ended_ns <= began_ns or 2 * inside_ns < ended_ns - began_ns:
        return None
    # Relative to the first sample, as for a process.
    times_s, ends_s = ((each - times[0]) / 1e9 for each in (times, np.array(window_ns)))

    def growth(field: str) -> float | None:
        """Return the growth of a sum; None where nothing counts it."""
        before, after = np.interp(ends_s, times_s, rows[field]).tolist()
        return max(0.0, after - before) if math.isfinite(after - before) else None

    of_run = [use for index, use in used.items() if index == ORPHANS_INDEX or index in processes]
    own = total_use(of_run) if of_run else None
    cores, busy_s, cycles = machine.get("cores"), growth("busy_s"), growth("cycles")
    stolen_s, waited_s = growth("stolen_s"), growth("waited_s")
    return HostInterference(
        seconds=seconds,
        cores=cores,
        threads_per_core=machine.get("threads_per_core"),
        steal=None if stolen_s is None or not cores else min(1.0, stolen_s / (seconds * cores)),
        foreign_cores=_foreign_cores(busy_s, own, used.get(CONTROLLER_INDEX), seconds),
        pressure=None if waited_s is None else min(1.0, waited_s / seconds),
        throttled_s=growth("throttled_s"),
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
