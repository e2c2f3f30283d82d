"""What a player publishes when: the events of a playback, computed from one round of a schedule.

An event is the messages that are published at one time; it has an entry for each of them. The
arrays here are those of the file that the player reads and completes
(`r2bspec.ipc.playback_file`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from r2bspec.ipc.schedule import NO_STEP

ENTRY_DTYPE = np.dtype(
    [
        ("due_ns", "<i8"),
        ("stamp_ns", "<i8"),
        ("published_ns", "<i8"),
        ("done_ns", "<i8"),
        ("inputs", "<i8"),
        ("offset", "<i8"),
        ("add_ns", "<i8"),
        ("size", "<i4"),
        ("place", "<i4"),
        ("source", "<i2"),
        ("is_published", "<i2"),
        ("left", "<i4"),
        ("step", "<i4"),
        ("complete", "<i4"),
    ]
)
"""One entry of a playback.

- `due_ns`: when its event is due, relative to the first step.
- `stamp_ns`: the stamp of the event, relative to the beginning of a playback that has stamps; 0 for
  the time of publication.
- `published_ns`, `done_ns`: when publishing began and ended; the player writes them, as the times
  above, into the first entry of the event, and the last one into the last entry.
- `inputs`: the inputs of the plan of which the complete step has messages, as bits; -1 for all.
- `source`, `offset`, `size`: where the message is; a source is an input of the plan, or /tf after
  them.
- `place`, `add_ns`: where in the message the player writes the stamp of the event plus `add_ns`;
  -1 for nowhere.
- `is_published`: a message with several stamps has an entry for each of them, of which the last is
  published.
- `left`: the entries of the event from this one on.
- `step`: of the playback, or `NO_STEP`.
- `complete`: how many steps, from the first, are complete once the event is published.
"""

Entries = NDArray[np.void]

_BLOCK = 1 << 17
"""Entries that are computed at once: 10 MB."""


@dataclass(frozen=True)
class Round:
    """One round of a schedule.

    Attributes:
        entries: of type `ENTRY_DTYPE`, in the order in which they are due. Steps and `complete`
            count from the beginning of the round.
        steps: how many it has.
    """

    entries: Entries
    steps: int

    def blocks(self, rate_hz: float, steps: int, first: int) -> Iterator[Entries]:
        """The entries of a playback, in blocks.

        Args:
            rate_hz: steps per second.
            steps: how many.
            first: the step of the round to begin with.
        """
        begin, end = self._bounds(steps, first)
        for start in range(begin, end, _BLOCK):
            turns, places = np.divmod(np.arange(start, min(start + _BLOCK, end)), self.entries.size)
            found = self.entries[places]
            numbers = turns * self.steps - first
            found["complete"] += numbers.astype(np.int32)
            found["step"] += np.where(found["step"] == NO_STEP, 0, numbers).astype(np.int32)
            self._set_times(found, turns, places, rate_hz)
            yield self._within(found, steps)

    def _bounds(self, steps: int, first: int) -> tuple[int, int]:
        """The first entry of a playback and the one after its last, in rounds without an end."""
        raise NotImplementedError

    def _set_times(
        self, entries: Entries, turns: NDArray[np.int64], places: NDArray[np.int64], rate_hz: float
    ) -> None:
        """Set due times and stamps; each entry is at one of `places` of one of the rounds."""
        raise NotImplementedError

    def _within(self, entries: Entries, steps: int) -> Entries:
        """Those that belong to the steps of a playback."""
        del steps
        return entries


@dataclass(frozen=True)
class CyclicRound(Round):
    """One round of steps without times.

    Attributes:
        at: for each entry, when it is due, in steps from the beginning of the round.
    """

    at: NDArray[np.float64]

    def _bounds(self, steps: int, first: int) -> tuple[int, int]:
        _, starts = np.unique(self.entries["step"], return_index=True)
        starts = starts[-self.steps :]  # without what belongs to no step
        turns, rest = divmod(first + steps, self.steps)
        return int(starts[first]), turns * self.entries.size + int(starts[rest])

    def _set_times(
        self, entries: Entries, turns: NDArray[np.int64], places: NDArray[np.int64], rate_hz: float
    ) -> None:
        del turns
        # What is between two steps comes after the one that it completes nothing more than.
        steps = entries["complete"] - 1
        in_round = self.entries["complete"][places] - 1
        # Relative to the first due time, so that rounding errors do not accumulate.
        entries["due_ns"] = np.rint((steps + self.at[places] - in_round) * (1e9 / rate_hz))


@dataclass(frozen=True)
class TimelineRound(Round):
    """One round of a recording; each playback begins at its beginning, so that all are equal.

    The due times and stamps of `entries` are those of the first round.

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
        of_last_round = (self.entries["step"] >= 0) & (self.entries["step"] <= last)
        return 0, turns * self.entries.size + int(np.flatnonzero(of_last_round)[-1]) + 1

    def _set_times(
        self, entries: Entries, turns: NDArray[np.int64], places: NDArray[np.int64], rate_hz: float
    ) -> None:
        del places, rate_hz
        entries["due_ns"] += turns * self.period_ns
        entries["stamp_ns"] += turns * self.stamp_period_ns

    def _within(self, entries: Entries, steps: int) -> Entries:
        found = entries[entries["step"] < steps]
        found["complete"] = np.minimum(found["complete"], steps)
        return found


def complete_steps(steps: NDArray[np.int32]) -> NDArray[np.int32]:
    """For each entry of a round, how many steps, from the first, are complete once it is published.

    Args:
        steps: of each entry, or `NO_STEP`. Every step has an entry.
    """
    of_steps = np.flatnonzero(steps != NO_STEP)
    last = np.zeros(int(steps.max()) + 1, dtype=np.int64)
    np.maximum.at(last, steps[of_steps], of_steps)
    completed_by = np.maximum.accumulate(last)
    return np.searchsorted(completed_by, np.arange(steps.size), side="right").astype(np.int32)
