"""What a player publishes when: the events of a playback, computed from one round of a schedule.

An event is the messages that are published at one time. The arrays here are those of the file that
the player reads and completes (`r2bspec.ipc.playback_file`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from r2bspec.ipc.schedule import NO_STEP

EVENT_DTYPE = np.dtype(
    [
        ("due_ns", "<i8"),
        ("stamp_ns", "<i8"),
        ("published_ns", "<i8"),
        ("done_ns", "<i8"),
        ("inputs", "<i8"),
        ("step", "<i4"),
        ("complete", "<i4"),
        ("first", "<i4"),
        ("count", "<i4"),
    ]
)
"""One event: when it is due, relative to the first step; its stamp, relative to the beginning if
the playback has stamps, and 0 if a stamp is the time of publication; when publishing began and
ended, which the player writes; the inputs of the plan of which the complete step has messages, as
bits, -1 for all; its step, or `NO_STEP`; how many steps, from the first, are complete once it is
published; and its messages in the list of the player."""

Events = NDArray[np.void]

_BLOCK = 1 << 18
"""Events that are computed at once: 14 MB."""


@dataclass(frozen=True)
class Round:
    """One round of a schedule.

    Attributes:
        events: of type `EVENT_DTYPE`, in the order in which they are due. Steps and `complete`
            count from the beginning of the round.
        steps: how many it has.
    """

    events: Events
    steps: int

    def blocks(self, rate_hz: float, steps: int, first: int) -> Iterator[Events]:
        """The events of a playback, in blocks.

        Args:
            rate_hz: steps per second.
            steps: how many.
            first: the step of the round to begin with.
        """
        begin, end = self._bounds(steps, first)
        for start in range(begin, end, _BLOCK):
            turns, places = np.divmod(np.arange(start, min(start + _BLOCK, end)), self.events.size)
            found = self.events[places]
            numbers = turns * self.steps - first
            found["complete"] += numbers.astype(np.int32)
            found["step"] += np.where(found["step"] == NO_STEP, 0, numbers).astype(np.int32)
            self._set_times(found, turns, places, rate_hz)
            yield self._within(found, steps)

    def _bounds(self, steps: int, first: int) -> tuple[int, int]:
        """The first event of a playback and the one after its last, in rounds without an end."""
        raise NotImplementedError

    def _set_times(
        self, events: Events, turns: NDArray[np.int64], places: NDArray[np.int64], rate_hz: float
    ) -> None:
        """Set due times and stamps; each event is at one of `places` of one of the rounds."""
        raise NotImplementedError

    def _within(self, events: Events, steps: int) -> Events:
        """Those that belong to the steps of a playback."""
        del steps
        return events


@dataclass(frozen=True)
class CyclicRound(Round):
    """One round of steps without times.

    Attributes:
        at: for each event, when it is due, in steps from the beginning of the round.
    """

    at: NDArray[np.float64]

    def _bounds(self, steps: int, first: int) -> tuple[int, int]:
        starts = np.flatnonzero(self.events["step"] != NO_STEP)
        turns, rest = divmod(first + steps, self.steps)
        return int(starts[first]), turns * self.events.size + int(starts[rest])

    def _set_times(
        self, events: Events, turns: NDArray[np.int64], places: NDArray[np.int64], rate_hz: float
    ) -> None:
        del turns
        # What is between two steps comes after the one that it completes nothing more than.
        steps = events["complete"] - 1
        in_round = self.events["complete"][places] - 1
        # Relative to the first due time, so that rounding errors do not accumulate.
        events["due_ns"] = np.rint((steps + self.at[places] - in_round) * (1e9 / rate_hz))


@dataclass(frozen=True)
class TimelineRound(Round):
    """One round of a recording; each playback begins at its beginning, so that all are equal.

    The due times and stamps of `events` are those of the first round.

    Attributes:
        period_ns: the duration of a round.
        stamp_period_ns: the same in the recording.
    """

    period_ns: int
    stamp_period_ns: int

    def _bounds(self, steps: int, first: int) -> tuple[int, int]:
        del first
        if steps == 0:
            return 0, 0
        turns, last = divmod(steps - 1, self.steps)
        # Steps may overlap: the playback ends when all of them are complete.
        of_last_round = (self.events["step"] >= 0) & (self.events["step"] <= last)
        return 0, turns * self.events.size + int(np.flatnonzero(of_last_round)[-1]) + 1

    def _set_times(
        self, events: Events, turns: NDArray[np.int64], places: NDArray[np.int64], rate_hz: float
    ) -> None:
        del places, rate_hz
        events["due_ns"] += turns * self.period_ns
        events["stamp_ns"] += turns * self.stamp_period_ns

    def _within(self, events: Events, steps: int) -> Events:
        found = events[events["step"] < steps]
        found["complete"] = np.minimum(found["complete"], steps)
        return found


def complete_steps(steps: NDArray[np.int32]) -> NDArray[np.int32]:
    """For each event of a round, how many steps, from the first, are complete once it is published.

    Args:
        steps: of each event, or `NO_STEP`. Every step has an event.
    """
    of_steps = np.flatnonzero(steps != NO_STEP)
    last = np.zeros(int(steps.max()) + 1, dtype=np.int64)
    np.maximum.at(last, steps[of_steps], of_steps)
    completed_by = np.maximum.accumulate(last)
    return np.searchsorted(completed_by, np.arange(steps.size), side="right").astype(np.int32)
