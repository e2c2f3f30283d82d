"""Whether an output has stopped, seen from the samples of one segment."""

from __future__ import annotations

import numpy as np

from r2bspec.measure.matching import Matching
from r2bspec.record.sample_arrays import Rows

_MIN_MISSED = 5
"""Answers that must be waited for in vain: fewer may be lost by chance."""

_PAUSE_FACTOR = 2.0
"""Times the longest pause before it: a graph that answers now and then is not silent between."""


def output_stopped(playback: Rows, rows: Rows, matching: Matching) -> bool:
    """Whether nothing came any more, whatever it answers, although much was still expected.

    Args:
        playback: rows of type `PLAYBACK_DTYPE` of a segment.
        rows: rows of type `MONITOR_DTYPE`, everything that came until the graph was taken for
            drained.
        matching: how they match.
    """
    asked_ns = playback["published_ns"][matching.trigger_steps]
    if not rows.size:
        return bool(asked_ns.size >= _MIN_MISSED)
    received_ns = np.sort(rows["received_ns"])
    last_ns = received_ns[-1]
    if np.count_nonzero(asked_ns > last_ns) < _MIN_MISSED:
        return False
    pauses_ns = np.diff(received_ns, prepend=min(received_ns[0], playback["published_ns"][0]))
    return bool(asked_ns[-1] - last_ns > _PAUSE_FACTOR * pauses_ns.max())
