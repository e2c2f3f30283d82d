"""Whether an output has stopped, seen from the samples of one segment."""

from __future__ import annotations

import numpy as np

from r2bspec.measure.matching import Matching
from r2bspec.record.sample_arrays import Rows

_LEAST = 5
"""Answers that must be waited for in vain: fewer may be lost by chance."""

_LONGER = 2.0
"""Times the longest pause before it: a graph that answers now and then is not silent between."""


def fell_silent(playback: Rows, rows: Rows, matched: Matching) -> bool:
    """Whether nothing came any more, whatever it answers, although much was still expected.

    Args:
        playback: rows of type `PLAYBACK` of a segment.
        rows: rows of type `MONITOR`, everything that came until the graph was taken for drained.
        matched: how they match.
    """
    asked_ns = playback["published_ns"][matched.asked]
    if not rows.size:
        return bool(asked_ns.size >= _LEAST)
    received_ns = np.sort(rows["received_ns"])
    last_ns = received_ns[-1]
    if np.count_nonzero(asked_ns > last_ns) < _LEAST:
        return False
    pauses_ns = np.diff(received_ns, prepend=min(received_ns[0], playback["published_ns"][0]))
    return bool(asked_ns[-1] - last_ns > _LONGER * pauses_ns.max())
