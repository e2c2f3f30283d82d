"""Times of single messages: latency, intervals between outputs, and jitter.

All inputs are whole nanoseconds; they become seconds only after the subtraction, when the numbers
are small enough for floating point to keep every nanosecond.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from r2bspec.measure.matching import Matching
from r2bspec.record.sample_arrays import Rows

Seconds = NDArray[np.float64]


def latencies(playback: Rows, monitor: Rows, match: Matching) -> Seconds:
    """Received - published of each output, in seconds, in the order of the steps.

    Published is when publishing of the step's first input began; received is when the
    middleware received the first output. Where several steps lead to one output, the last of
    them counts: the graph could not respond before.

    Returns:
        Shape (answered,).
    """
    return _elapsed_since(playback["published_ns"], monitor, match)


def latencies_from_due(playback: Rows, monitor: Rows, match: Matching) -> Seconds:
    """Received - due of each output, in seconds, in the order of the steps.

    Free of coordinated omission: delays of the playback count.

    Returns:
        Shape (answered,).
    """
    return _elapsed_since(playback["due_ns"], monitor, match)


def _elapsed_since(start_ns: NDArray[np.int64], monitor: Rows, match: Matching) -> Seconds:
    answered = match.answered
    received = monitor["received_ns"][match.first_row[answered]]
    return seconds(received - start_ns[match.trigger_steps[answered]])


def arrivals(monitor: Rows, match: Matching) -> NDArray[np.int64]:
    """When each first output was received, in ascending nanoseconds; shape (answered,).

    Duplicates and messages that match no step are left out: they are counted elsewhere, and
    would make a graph look faster than it is.
    """
    return np.sort(monitor["received_ns"][match.first_row[match.answered]])


def intervals(arrived_ns: NDArray[np.int64]) -> Seconds:
    """t[i+1] - t[i] in seconds; shape (n - 1,)."""
    return seconds(np.diff(arrived_ns))


def jitter(arrived_ns: NDArray[np.int64]) -> Seconds:
    """|(t[i+2] - t[i+1]) - (t[i+1] - t[i])| in seconds; shape (n - 2,)."""
    if arrived_ns.size < 3:
        return np.empty(0)
    return seconds(np.abs(np.diff(arrived_ns, 2)))


def seconds(ns: NDArray[np.int64]) -> Seconds:
    """Differences of nanoseconds as seconds."""
    return ns.astype(np.float64) / 1e9
