"""Which played messages begin an event, and which outputs meet the condition of a monitor.

Played messages are in the buffers. The monitor has kept the beginnings of its messages, and both
are read between two segments, when nothing is timed. What follows from the marks is worked out by
`r2bspec.judge.measure.reactions`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from r2bspec.ipc import buffers
from r2bspec.ipc.sample_files import HeadReader, heads_path
from r2bspec.ipc.schedule import NO_STEP, CyclicSchedule, Schedule
from r2bspec.judge.measure.matching import input_mask
from r2bspec.judge.measure.reactions import (
    EVENT,
    MET,
    UNFINISHED,
    UNREADABLE,
    begin_events,
    live_source,
    marks_of,
)
from r2bspec.language.comparison_grammar import parse_condition
from r2bspec.plan.message_conditions import MessageCondition, UnreadableError, message_condition
from r2bspec.plan.plan import MonitorPlan, Plan, ReactionPlan
from r2bspec.record.sample_arrays import Rows


@dataclass
class ReactionMarks:
    """The marks of one monitor, over the segments of a session.

    Attributes:
        plan: of the run.
        monitor: with a reaction.
        schedule: of the player.
        buffer_dir: has the messages that are played.
        rows_dir: has what the monitor writes.
    """

    plan: Plan
    monitor: MonitorPlan
    schedule: Schedule
    buffer_dir: Path
    rows_dir: Path

    def __post_init__(self) -> None:
        reaction = self.monitor.reaction
        assert reaction  # noqa: S101 - the caller looks
        self._heads = HeadReader(heads_path(self.rows_dir, self.monitor.name))
        self._when = _holds(reaction.when, self.monitor.type)
        is_live = self.plan.playback_mode == "live"
        self._source = live_source(self.plan, self.monitor) if is_live else None
        self._round = None
        if self._source is not None:
            self._source_heads = HeadReader(heads_path(self.rows_dir, self._source.name))
        elif reaction.since:
            self._round = self._read_round(reaction, self.buffer_dir)

    def marks(
        self, playback: Rows, played_before: int, numbers: Mapping[str, NDArray[np.intp]]
    ) -> Rows:
        """The marks of a segment.

        Args:
            playback: rows of type `PLAYBACK_DTYPE`: its steps.
            played_before: how many steps the player had played before, since it was started.
            numbers: by monitor, the numbers of its messages in the segment among all that it
                received.
        """
        found = _held(self._heads, self._when, numbers[self.monitor.name])
        met = np.flatnonzero([one is True for one in found])
        unreadable = np.flatnonzero([one is None for one in found])
        if self._source is not None:
            events, unfinished = self._live_events(numbers[self._source.name])
        else:
            events, unfinished = self._events(playback, played_before)
        return np.concatenate(
            [
                marks_of(EVENT, events),
                marks_of(MET, met),
                marks_of(UNREADABLE, unreadable),
                marks_of(UNFINISHED, unfinished),
            ]
        )

    def _live_events(self, numbers: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The messages of the monitored input that begin an event; see `_events`.

        What was before the first of them is not known.
        """
        reaction = self.monitor.reaction
        if not reaction or not reaction.since:
            return np.arange(numbers.size), np.arange(0)
        holds = _holds(reaction.since, reaction.input_type)
        held = np.array(
            [one is True for one in _held(self._source_heads, holds, numbers)], np.bool_
        )
        begun = np.flatnonzero(begin_events(held, held_before=True))
        whole = begun.size - int(held[-1:].any())
        return begun[:whole], begun[whole:]

    def _events(
        self, playback: Rows, played_before: int
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The rows of the steps that begin an event; and those of which `from` holds to the end."""
        reaction = self.monitor.reaction
        topics = (reaction.input,) if reaction and reaction.since else self.monitor.answers
        mask = input_mask(self.plan.inputs, topics)
        rows = np.flatnonzero((playback["inputs"] & mask) == mask)
        if self._round is None or not rows.size:
            return rows, rows[:0]
        # A timeline begins anew with each playback, a cyclic schedule goes on.
        goes_on = isinstance(self.schedule, CyclicSchedule)
        begin = played_before if goes_on else 0
        places = self._round.number_of[(begin + rows) % self._round.number_of.size]
        held = self._round.held
        before = bool(held[places[0] - 1]) if goes_on else False
        begun = np.flatnonzero(begin_events(held[places], before))
        whole = begun + lengths(held)[places[begun]] <= rows.size
        return rows[begun[whole]], rows[begun[~whole]]

    def _read_round(self, reaction: ReactionPlan, buffer_dir: Path) -> _Round:
        """What the messages of the input in one round say."""
        topics = [source.topic for source in self.plan.inputs]
        number = topics.index(reaction.input)
        positions = _positions(self.schedule, number, len(topics))
        holds = _holds(reaction.since, reaction.input_type)
        source = self.plan.inputs[number].source
        wanted = {position for position in positions if position is not None}
        messages = buffers.read_messages(buffer_dir, source, wanted)
        met = {position: holds(bytes(message)) is True for position, message in messages.items()}
        has_one = np.array([position is not None for position in positions])
        held = [met.get(position, False) for position in positions if position is not None]
        return _Round(np.cumsum(has_one) - 1, np.array(held, np.bool_))


@dataclass(frozen=True)
class _Round:
    """The messages of an input in one round of a schedule.

    Attributes:
        number_of: for each step the number of its message among them; for one without, of the last.
        held: for each of them, whether it meets the condition.
    """

    number_of: NDArray[np.int64]
    held: NDArray[np.bool_]


def lengths(held: NDArray[np.bool_]) -> NDArray[np.int64]:
    """For each message of a round, how many meet the condition from it on, one after the other."""
    twice = np.concatenate([held, held])
    ends = np.where(twice, 2 * held.size, np.arange(2 * held.size))
    next_end = np.minimum.accumulate(ends[::-1])[::-1]
    return np.asarray(next_end[: held.size] - np.arange(held.size))


def _positions(schedule: Schedule, number: int, inputs: int) -> list[int | None]:
    """For each step of a round, the position of its message of an input; None without one."""
    if isinstance(schedule, CyclicSchedule):
        columns = schedule.columns or tuple(range(inputs))
        column = columns.index(number)
        return [step[column] for step in schedule.steps]
    positions: list[int | None] = [None] * len(schedule.steps)
    for message in schedule.messages:
        if message.step != NO_STEP and message.input == number:
            positions[message.step] = message.position
    return positions


def _held(
    heads: HeadReader, holds: Callable[[bytes], bool | None], numbers: NDArray[np.intp]
) -> list[bool | None]:
    """Whether messages meet a condition; None for those that cannot be read."""
    return [None if head is None else holds(head) for head in heads.pick(numbers.tolist())]


def _holds(text: str, type_name: str) -> Callable[[bytes], bool | None]:
    """Whether a message meets a condition; None for one that cannot be read."""
    condition: Any = message_condition(parse_condition(text), type_name)

    def holds(message: bytes) -> bool | None:
        if not isinstance(condition, MessageCondition):
            return None
        try:
            return condition.holds(message)
        except UnreadableError:
            return None

    return holds
