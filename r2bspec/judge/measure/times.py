"""Times of single messages and what they add up to: latency, intervals, jitter, rates, percentiles.

All inputs are whole nanoseconds; they become seconds only after the subtraction, when the numbers
are small enough for floating point to keep every nanosecond.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Seconds = NDArray[np.float64]


def intervals(arrived_ns: NDArray[np.int64]) -> Seconds:
    """Return t[i+1] - t[i] in seconds; shape (n - 1,)."""
    return seconds(arrived_ns[1:] - arrived_ns[:-1])


def jitter(arrived_ns: NDArray[np.int64]) -> Seconds:
    """Return |(t[i+2] - t[i+1]) - (t[i+1] - t[i])| in seconds; shape (n - 2,)."""
    if arrived_ns.size < 3:
        return np.empty(0)
    between = arrived_ns[1:] - arrived_ns[:-1]
    return seconds(np.abs(between[1:] - between[:-1]))


def seconds(ns: NDArray[np.int64]) -> Seconds:
    """Return differences of nanoseconds as seconds."""
    return ns.astype(np.float64) / 1e9


def mean_rate(times_ns: NDArray[np.int64]) -> float:
    """Return (n - 1) / (t_last - t_first) in Hz; 0 for fewer than two events.

    n events bound n - 1 periods: dividing n by the same time would give 10.2 Hz for 10 Hz.
    """
    span_ns = int(times_ns[-1] - times_ns[0]) if times_ns.size else 0
    return (times_ns.size - 1) / (span_ns / 1e9) if span_ns > 0 else 0.0


def edge_gaps(arrived_ns: NDArray[np.int64], soonest_ns: int, ended_ns: int) -> tuple[int, int]:
    """Return the gaps, in ns, before the first and after the last output that count.

    A graph that dies in the middle has perfect intervals up to then. So a gap at an end counts if
    it is longer than every gap between two outputs; a shorter gap is only the phase between the
    playback's clock and the outputs, and does not count.

    Args:
        arrived_ns: when outputs were received, ascending, at least one.
        soonest_ns: when the first output could have come: publication of the first step plus
            the shortest latency.
        ended_ns: the end of the sending window.

    Returns:
        0 for an ordinary one.
    """
    longest = int((arrived_ns[1:] - arrived_ns[:-1]).max()) if arrived_ns.size > 1 else 0
    before = int(arrived_ns[0]) - soonest_ns
    after = ended_ns - int(arrived_ns[-1])
    return before if before > longest else 0, after if after > longest else 0


def throughput(
    arrived_ns: NDArray[np.int64], soonest_ns: int, window_ns: float, period_ns: float = 0.0
) -> float:
    """Return the outputs per window of time, in Hz.

    With n outputs, output k of them (from 1 on) received t_k after the first could come, a window
    of length w and a period p::

        throughput = n / w                            if t_n <= w
                     max over k of k / max(w, t_k + p)   otherwise

    n steps at rate r take w = n / r, so a graph that answers all of them in that time gets r,
    whatever its latency and however its outputs are bunched. The outputs of a graph that is slower
    than the player go on after the window; they extend the time, to that of the most favourable
    output, so that one straggler does not count against the others. The last output of that time
    has a period of its own: n outputs bound n - 1 periods. Throughput is never more than the
    answered share of the offered rate.

    Args:
        arrived_ns: when outputs were received, ascending.
        soonest_ns: when the first output could have come: publication of the first step plus the
            shortest latency; in a live run, the beginning of the window.
        window_ns: the time in which as many outputs as expected are due, if each is due one
            period after the one before.
        period_ns: that period; 0 where outputs have none.
    """
    if not arrived_ns.size or window_ns <= 0:
        return 0.0
    elapsed_ns = arrived_ns - soonest_ns
    if elapsed_ns[-1] <= window_ns:
        return arrived_ns.size / (window_ns / 1e9)
    counts = np.arange(1, arrived_ns.size + 1)
    return float(np.max(counts / np.maximum(elapsed_ns + period_ns, window_ns))) * 1e9


def faster_half(values: Seconds) -> Seconds:
    """Return the values with the slower half replaced by the faster half."""
    better = -(-values.size // 2)
    order = np.argsort(values, kind="stable")
    found = values.copy()
    found[order[better:]] = values[order[: values.size - better]]
    return found


def percentile(values: NDArray[np.float64], q: float, lost: int = 0) -> float | None:
    """Return the value at or below which a fraction `q` of all messages lies.

    Nearest rank, which is the inverse of the empirical distribution function: with the n values in
    ascending order, followed by `lost` times infinity, it is the k-th, where

        k = max(1, ceil(q (n + lost)))

    It is always an observed value, never an interpolated one.

    Args:
        values: shape (n,), in any order, finite.
        q: 0 < q <= 1.
        lost: messages that never arrived; they count as later than every other.

    Returns:
        None if there are no messages; infinity if the k-th was lost.
    """
    total = values.size + lost
    if total == 0:
        return None
    k = rank(q, total)
    if k > values.size:
        return math.inf
    return float(np.partition(values, k - 1)[k - 1])


def rank(q: float, n: int) -> int:
    """Return the smallest k of 1..n with k / n >= q, without rounding errors.

    0.07 x 100 is 7.000000000000001 in binary floating point; the tolerance keeps it 7.
    """
    return min(n, max(1, math.ceil(q * n - 1e-9 * n)))
