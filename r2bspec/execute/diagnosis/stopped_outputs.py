"""Detecting from the samples of one segment that an output has stopped."""

from __future__ import annotations

import numpy as np

from r2bspec.measure.matching import Matching
from r2bspec.record.sample_arrays import Rows

_MIN_MISSED = 5
"""How many expected messages must be missing at the end; fewer may be lost by chance."""

_PAUSE_FACTOR = 2.0
"""The final pause, as a multiple of the longest one before it: rare output has long pauses."""


def output_stopped(playback: Rows, rows: Rows, matching: Matching) -> bool:
    """Whether the output stopped while messages were still expected.

    Args:
        playback: rows of type `PLAYBACK_DTYPE` of a segment.
        rows: rows of type `MONITOR_DTYPE`, all that were received until the graph was drained.
        matching: of the two.
    """
    expected_ns = playback["published_ns"][matching.trigger_steps]
    if not rows.size:
        return bool(expected_ns.size >= _MIN_MISSED)
    received_ns = np.sort(rows["received_ns"])
    last_ns = received_ns[-1]
    if np.count_nonzero(expected_ns > last_ns) < _MIN_MISSED:
        return False
    pauses_ns = np.diff(received_ns, prepend=min(received_ns[0], playback["published_ns"][0]))
    return bool(expected_ns[-1] - last_ns > _PAUSE_FACTOR * pauses_ns.max())
