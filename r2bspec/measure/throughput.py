"""Rates of events, and the gaps that a rate from the first to the last event would hide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


def mean_rate(times_ns: NDArray[np.int64]) -> float:
    """(n - 1) / (t_last - t_first) in Hz; 0 for fewer than two events.

    n events bound n - 1 periods: dividing n by the same time would give 10.2 Hz for 10 Hz.
    """
    return _rate(times_ns.size, int(times_ns[-1] - times_ns[0])) if times_ns.size else 0.0


@dataclass(frozen=True)
class EdgeGaps:
    """Gaps at the ends of a sending window, in ns; 0 for an ordinary one."""

    before_ns: int
    after_ns: int


def edge_gaps(arrived_ns: NDArray[np.int64], soonest_ns: int, ended_ns: int) -> EdgeGaps:
    """The gaps before the first and after the last output that are part of the measurement.

    A graph that dies in the middle has perfect intervals up to then. So a gap at an end counts if
    it is longer than every gap between two outputs; an ordinary one is only the phase between the
    playback's clock and the outputs, and does not count.

    Args:
        arrived_ns: when outputs were received, ascending, at least one.
        soonest_ns: when the first output could have come: publication of the first step plus
            the shortest latency.
        ended_ns: the end of the sending window.
    """
    longest = int(np.max(np.diff(arrived_ns))) if arrived_ns.size > 1 else 0
    before = int(arrived_ns[0]) - soonest_ns
    after = ended_ns - int(arrived_ns[-1])
    return EdgeGaps(before if before > longest else 0, after if after > longest else 0)


def throughput(arrived_ns: NDArray[np.int64], gaps: EdgeGaps, burst: int = 1) -> float:
    """(n - 1) / (t_last - t_first) in Hz; 0 for fewer than two outputs.

    A gap at an end adds to the time by what exceeds the longest gap between outputs: an ordinary
    gap does not count.

    Where each group of steps has `burst` outputs, the first burst takes the place of the first
    output: (n - burst) / (t_last - t_burst). The n outputs bound no more periods than their bursts
    do, however close together the outputs of one burst are.
    """
    if burst > 1:
        arrived_ns = arrived_ns[burst - 1 :]
    if arrived_ns.size < 2:
        return 0.0
    longest = int(np.max(np.diff(arrived_ns)))
    beyond = sum(max(0, gap - longest) for gap in (gaps.before_ns, gaps.after_ns))
    return _rate(arrived_ns.size, int(arrived_ns[-1] - arrived_ns[0]) + beyond)


def _rate(n: int, span_ns: int) -> float:
    return (n - 1) / (span_ns / 1e9) if n > 1 and span_ns > 0 else 0.0
