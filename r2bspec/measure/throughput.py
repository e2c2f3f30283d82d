"""Rates of events, and the silences that a rate from the first to the last event would hide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


def mean_rate(times_ns: NDArray[np.int64]) -> float:
    """(n - 1) / (t_last - t_first) in Hz; 0 for fewer than two events.

    n events bound n - 1 periods: dividing n by the same time would read 10.2 Hz for 10 Hz.
    """
    return _rate(times_ns.size, int(times_ns[-1] - times_ns[0])) if times_ns.size else 0.0


@dataclass(frozen=True)
class EdgeGaps:
    """Pauses at the ends of a sending window, in ns; 0 where there was none to speak of."""

    before_ns: int
    after_ns: int


def edge_gaps(arrived_ns: NDArray[np.int64], soonest_ns: int, ended_ns: int) -> EdgeGaps:
    """The pauses before the first and after the last output that are part of the measurement.

    A graph that dies in the middle has perfect intervals up to then. So a pause at an end
    counts if it is longer than every pause between two outputs; an ordinary one is only the
    phase between the playback's clock and the outputs, and does not.

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


def throughput(arrived_ns: NDArray[np.int64], silent: EdgeGaps, burst: int = 1) -> float:
    """(n - 1) / (t_last - t_first) in Hz; 0 for fewer than two outputs.

    Of a silence at an end, the part beyond the longest pause between outputs adds to the time:
    what an ordinary pause would have been is not held against the graph.

    Where `burst` outputs answer each group of steps, the first burst takes the place of the
    first output: (n - burst) / (t_last - t_burst). The n outputs bound no more periods than
    their bursts do, however close together those of one burst come.
    """
    if burst > 1:
        arrived_ns = arrived_ns[burst - 1 :]
    if arrived_ns.size < 2:
        return 0.0
    longest = int(np.max(np.diff(arrived_ns)))
    pauses = (silent.before_ns, silent.after_ns)
    beyond = sum(max(0, pause - longest) for pause in pauses)
    return _rate(arrived_ns.size, int(arrived_ns[-1] - arrived_ns[0]) + beyond)


def _rate(n: int, span_ns: int) -> float:
    return (n - 1) / (span_ns / 1e9) if n > 1 and span_ns > 0 else 0.0
