"""The step that a stamp belongs to, where the messages of one step have different stamps.

An output carries the stamp of one of its inputs, whichever the node copies. Where stamps within a
step differ (`r2bspec.plan.nearest_stamps`), the stamp of an output is therefore replaced
by that of its step before anything is matched or recorded.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from r2bspec.ipc.schedule import Schedule, TimelineSchedule
from r2bspec.record.sample_arrays import Rows


class StepStamps:
    """Replaces the stamps of received messages by those of their steps.

    Outputs of earlier steps are known, too: late ones are then recognised in a later segment.
    """

    def __init__(self, schedule: Schedule) -> None:
        self._offsets_ns = np.array(schedule.stamp_offsets_ns, dtype=np.int64)
        self._restarts = isinstance(schedule, TimelineSchedule)
        # Of all inputs played before, ascending, and the stamp of the step of each.
        self._inputs_ns: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self._steps_ns: NDArray[np.int64] = np.empty(0, dtype=np.int64)

    def replace(self, received: Rows, playback: Rows, first: int) -> Rows:
        """The rows with the stamps of steps where theirs is that of an input of the step.

        Args:
            received: rows of type `MONITOR_DTYPE`.
            playback: rows of type `PLAYBACK_DTYPE` that were played in one go.
            first: the number of the first of them among all that the player has played.
        """
        if not self._offsets_ns.size or not received.size:
            return received
        found = received.copy()
        # Where a stamp belongs to two steps, the earlier one counts.
        for inputs_ns, steps_ns in (
            _ascending(*self._stamps(playback, first)),
            (self._inputs_ns, self._steps_ns),
        ):
            if not inputs_ns.size:
                continue
            place = np.searchsorted(inputs_ns, received["stamp_ns"])
            place = np.minimum(place, inputs_ns.size - 1)
            belongs = inputs_ns[place] == received["stamp_ns"]
            found["stamp_ns"][belongs] = steps_ns[place[belongs]]
        return found

    def remember(self, playback: Rows, first: int) -> None:
        """Keep the stamps of steps that have been played; arguments as in `replace`."""
        if not self._offsets_ns.size:
            return
        inputs_ns, steps_ns = _ascending(*self._stamps(playback, first))
        # Later steps have later stamps, as a rule; then nothing is moved.
        place = np.searchsorted(self._inputs_ns, inputs_ns, side="right")
        self._inputs_ns = np.insert(self._inputs_ns, place, inputs_ns)
        self._steps_ns = np.insert(self._steps_ns, place, steps_ns)

    def _stamps(self, playback: Rows, first: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The stamps of all inputs of some steps, and for each that of its step; shape (n,)."""
        # A timeline begins anew with each playback, a cyclic schedule goes on.
        begin = 0 if self._restarts else first
        places = (begin + np.arange(playback.size)) % len(self._offsets_ns)
        offsets_ns = self._offsets_ns[places]
        steps_ns = np.broadcast_to(playback["stamp_ns"][:, np.newaxis], offsets_ns.shape)
        return (steps_ns + offsets_ns).ravel(), steps_ns.ravel()


def _ascending(
    inputs_ns: NDArray[np.int64], steps_ns: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    order = np.argsort(inputs_ns, kind="stable")
    return inputs_ns[order], steps_ns[order]
