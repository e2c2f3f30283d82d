"""Live runs: the graph has its own source, and what that sent is unknown.

What arrived is known, and when. A message with a header carries the time at which its source
stamped it, in the clock of this machine, so that

    latency = received - stamp

This is known for an iteration only if the stamps are times of that clock: not if more than one in a
hundred is after the reception of its message or more than an hour before it, as with stamps that
were never set, or come from a simulation or a recording; and not if the clock was set meanwhile.
What was sent, missed, duplicated or reordered is unknown, and no metric of it has a value.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from r2bspec.record.run_record import Segment
from r2bspec.record.sample_arrays import Rows

_MAX_CLOCK_SKEW_NS = 1_000_000
"""Two clock readings may be this far apart, if a process was interrupted between them."""

_MAX_STAMP_AGE_NS = 3_600_000_000_000
_MAX_IMPLAUSIBLE_SHARE = 0.01


def source_times_ns(segment: Segment, rows: Rows) -> NDArray[np.int64] | None:
    """When the source stamped each message, on the monotonic clock.

    Args:
        segment: of a live run.
        rows: what a monitor received in it, of type `MONITOR_DTYPE`; the stamps are of the system
            clock.

    Returns:
        Shape (messages,); None if that is not known.
    """
    offset_ns = segment.clock_offset_ns
    if offset_ns is None or not rows.size:
        return None
    stamped: NDArray[np.int64] = rows["stamp_ns"] - offset_ns
    age_ns = rows["received_ns"] - stamped
    odd = np.count_nonzero((age_ns < -_MAX_CLOCK_SKEW_NS) | (age_ns > _MAX_STAMP_AGE_NS))
    return None if odd > _MAX_IMPLAUSIBLE_SHARE * rows.size else stamped
