"""What the waiting of the run's own processes can explain, where the kernel counts it.

Other programs slow a run down while its threads could run but do not (`own_waited`), while the
processors that it runs on are shared with them, stolen, or throttled. So they took at most the
share

    w = waited + 1/2 min(own cores, foreign cores) + stolen + throttled

of the time from it. The sum is over all threads, of the harness, too, though they may have waited
at once; a processor whose second hardware thread runs another program is at least half as fast.
Waiting of other programs counts in the pressure of the machine, but explains nothing: a node that
sleeps is not slowed down by them.

From w follows, for n messages offered at a rate r, of which c come out per second:

    lost        at most w n + 1 messages: those for whose service there was time otherwise
    throughput  at most w r more
    latency     A second of waiting delays the messages that are in the graph then, and those that
                come before the graph is idle again. So messages were delayed by at most w T m in
                total, with T the length of the iteration, and m the largest number of messages in
                one busy period. This is distributed in the most favourable way: the latency of
                rank k is at least the u for which the k fastest exceed u by w T m in total. No
                message was delayed by more than w T.

A graph that is overloaded anyway, because c + w r < r, is never idle, and one busy period would
explain everything. There the backlog grows at the rate r - c - w r instead of r - c, and is served
at the rate c + w r instead of c. Latencies are proportional to the backlog:

    latency     at least the latency x (r - c - w r) / (r - c) x c / (c + w r)

or the bound above, with m the largest number of messages in the graph at once, if that is less.
Both less 1 / r: when a message finds the graph ready depends on where in a period that is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from r2bspec.measure.host_usage import HostInterference
from r2bspec.measure.samples import MonitorSamples

MAX_SHARE = 0.75
"""A machine on which everything takes over four times as long keeps no schedule either."""

_SHARED_PROCESSOR_LOSS = 0.5


def taken_share(known: HostInterference | None) -> float | None:
    """The largest share of the time that others can have taken from the run: w above.

    Returns:
        None where the run-queue wait is unknown.
    """
    if known is None or known.own_waited is None:
        return None
    waited = known.own_waited
    if known.pressure is not None:
        # While a thread of the run waits, some task does.
        waited = min(waited, known.pressure)
    shared = min(known.own_cores or 0.0, known.foreign_cores or 0.0)
    stolen = (known.steal or 0.0) * (known.cores or 1)
    throttled = (known.throttled_s or 0.0) / known.seconds if known.seconds else 0.0
    slower = 1 - 1 / known.calibration if known.calibration else 0.0
    share = waited + _SHARED_PROCESSOR_LOSS * shared + stolen + throttled
    return min(MAX_SHARE, max(share, slower))


def shortest_latencies(
    seen: MonitorSamples, taken: float, seconds: float, offered_hz: float
) -> NDArray[np.float64]:
    """The shortest latencies that waiting leaves possible, in ns, ascending; infinite for lost.

    Args:
        seen: what a monitor received.
        taken: the share w of the time.
        seconds: the length of the iteration.
        offered_hz: the rate at which outputs were expected.
    """
    steps = seen.steps
    published, received = steps.published_ns[steps.answered], steps.received_ns[steps.answered]
    latency = np.sort((received - published).astype(np.float64))
    lost = int(steps.answered.size) - int(latency.size)
    if not taken:
        return np.concatenate((latency, np.full(lost, np.inf)))
    lasting_ns = taken * seconds * 1e9
    answered_hz = latency.size / seconds if seconds else 0.0
    possible_hz = answered_hz + taken * offered_hz
    if answered_hz > 0 and possible_hz < offered_hz:
        growth = (offered_hz - possible_hz) / (offered_hz - answered_hz)
        at_once = _most_at_once(published, received)
        shorter = np.minimum(
            latency * growth * (answered_hz / possible_hz),
            _level(latency, lasting_ns * at_once),
        )
        latency = np.maximum(0.0, np.maximum(shorter, latency - lasting_ns) - 1e9 / offered_hz)
    else:
        longest = _longest_busy_period(published, received)
        latency = np.maximum(_level(latency, lasting_ns * longest), latency - lasting_ns)
    explained = min(lost, int(np.ceil(taken * steps.answered.size)) + 1)
    return np.concatenate((np.zeros(explained), latency, np.full(lost - explained, np.inf)))


def _level(ascending: NDArray[np.float64], budget: float) -> NDArray[np.float64]:
    """For each rank k, the u with sum over i <= k of max(0, x_i - u) = budget; at least 0.

    If j values are above u, those up to rank k, then u = (their sum - budget) / j. u grows with k,
    and so does the first rank above it.
    """
    sums = np.concatenate(([0.0], np.cumsum(ascending)))
    found = np.zeros(ascending.size)
    first = 0
    for rank in range(1, ascending.size + 1):
        level = (sums[rank] - sums[first] - budget) / (rank - first)
        while first < rank - 1 and ascending[first] <= level:
            first += 1
            level = (sums[rank] - sums[first] - budget) / (rank - first)
        found[rank - 1] = max(0.0, level)
    return found


def _most_at_once(published: NDArray[np.int64], received: NDArray[np.int64]) -> int:
    """The largest number of messages that were in the graph at once."""
    if not published.size:
        return 0
    order = np.argsort(np.concatenate((published, received)), kind="stable")
    changes = np.concatenate((np.ones(published.size), -np.ones(received.size)))[order]
    return int(np.cumsum(changes).max())


def _longest_busy_period(published: NDArray[np.int64], received: NDArray[np.int64]) -> int:
    """The largest number of messages during which the graph was never empty."""
    if not published.size:
        return 0
    order = np.argsort(published, kind="stable")
    starts, ends = published[order], np.maximum.accumulate(received[order])
    # A message begins a busy period if all before it were answered when it was published.
    first = np.flatnonzero(np.concatenate(([True], starts[1:] > ends[:-1])))
    return int(np.diff(np.append(first, starts.size)).max())
