"""Schedules of playback, which the controller builds and the player executes.

A schedule is one round of steps, which is repeated. A step consists of the messages with one header
stamp, or with stamps that the spec allows to differ. There are two kinds:

`CyclicSchedule` has no times: the messages of a step are due together, the steps follow each other
at the requested rate, and the stamp of a step is the time of its publication.

`TimelineSchedule` has the times of a recording: each message has its own due time. A step is due
with its first message. The stamps of a round are those of the recording, shifted by one constant,
so that they stay consistent with each other; each round shifts them further by the recorded length
of a round, so that no stamp is repeated.

Transforms can be played with both, and in a cyclic schedule the messages of inputs with a rate of
their own. They belong to no step and do not count as steps.
"""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import msgspec

NO_STEP = -1
"""The step of messages that belong to none."""

ALL_INPUTS = -1
"""The set of all inputs, as bits."""


class PlaybackEvent(NamedTuple):
    """Messages to be published at one time.

    Attributes:
        offset_ns: the due time, relative to the first step of the playback.
        step: its number in the playback, or `NO_STEP`.
        messages: (input, position in the input's buffer) of each message; the inputs are numbered
            in the order of the plan, and the transforms follow the last one.
        inputs: the inputs of which the complete step has messages, as bits.
        stamp_ns: the stamp of the step, relative to the time of the first step; None for the time
            of its publication.
        origin_ns: for transforms, the recorded time that is shifted to `stamp_ns`; their stamps
            are shifted by the same difference.
        starts_step: whether the step begins with this event.
        ends_step: whether the step ends with this event.
        stamp_offsets_ns: for each of the messages, its stamp minus that of the step; empty if all
            are 0.
    """

    offset_ns: int
    step: int
    messages: tuple[tuple[int, int], ...]
    inputs: int = ALL_INPUTS
    stamp_ns: int | None = None
    origin_ns: int = 0
    starts_step: bool = True
    ends_step: bool = True
    stamp_offsets_ns: tuple[int, ...] = ()


class BetweenMessage(msgspec.Struct, frozen=True, array_like=True):
    """A message of an input with a rate of its own, which is played between two steps.

    Attributes:
        at: the due time, in steps from the beginning of the round. The stamp is this time.
        input: the number of the input in the plan.
        position: of the message in the buffer of the input.
    """

    at: float
    input: int
    position: int


class CyclicTransform(msgspec.Struct, frozen=True, array_like=True):
    """Recorded transforms between two steps.

    Attributes:
        at: the due time, in steps from the beginning of the round.
        position: of the message in its buffer.
        origin_ns: the recorded time that corresponds to `at`, on the clock of header stamps.
    """

    at: float
    position: int
    origin_ns: int


class CyclicSchedule(msgspec.Struct, frozen=True, kw_only=True, tag="cyclic"):
    """Steps without times.

    Attributes:
        steps: ``steps[i][k]`` is the position of the message of step i in input ``columns[k]``.
        transforms: recorded transforms, by their due times.
        columns: the inputs of the steps, by their numbers in the plan; empty for all of them.
        between: messages of the other inputs, by their due times.
        stamp_offsets_ns: for each step and column, the stamp of the message minus that of the
            step; empty if all are 0.
    """

    steps: tuple[tuple[int, ...], ...]
    transforms: tuple[CyclicTransform, ...] = ()
    columns: tuple[int, ...] = ()
    between: tuple[BetweenMessage, ...] = ()
    stamp_offsets_ns: tuple[tuple[int, ...], ...] = ()

    def span_ns(self, rate_hz: float, steps: int) -> int:
        """How long so many steps take, up to when the one after them would be due."""
        return round(steps * 1e9 / rate_hz)

    def steps_within(self, rate_hz: float, duration_ns: int) -> int:
        """How many steps are due within a time."""
        return round(duration_ns / 1e9 * rate_hz)

    def positions_used(self) -> list[set[int]]:
        """The positions that are played, for each input and then for the transforms."""
        used: dict[int, set[int]] = {each: set() for each in self._inputs()}
        for number, positions in zip(self._inputs(), zip(*self.steps, strict=True), strict=True):
            used[number].update(positions)
        for each in self.between:
            used.setdefault(each.input, set()).add(each.position)
        return [*(used[each] for each in sorted(used)), {each.position for each in self.transforms}]

    def _inputs(self) -> tuple[int, ...]:
        """The inputs of the steps, by their numbers in the plan."""
        return self.columns or tuple(range(len(self.steps[0])))

    def events(self, rate_hz: float, steps: int, first: int = 0) -> Iterator[PlaybackEvent]:
        """What to publish, in the order in which it is due.

        Args:
            rate_hz: steps per second.
            steps: how many.
            first: the step of the round to begin with.
        """
        period_ns = 1e9 / rate_hz
        length = len(self.steps)
        columns = self._inputs()
        extras = self.without_step()
        starts = [each[0] for each in extras]
        inputs = sum(1 << each for each in columns) if self.between else ALL_INPUTS
        for step in range(steps):
            place = (first + step) % length
            # Relative to the first due time, so that rounding errors do not accumulate.
            yield PlaybackEvent(
                round(step * period_ns),
                step,
                tuple(zip(columns, self.steps[place], strict=True)),
                inputs,
                stamp_offsets_ns=self.stamp_offsets_ns[place] if self.stamp_offsets_ns else (),
            )
            for at, message, origin_ns in extras[
                bisect.bisect_left(starts, place) : bisect.bisect_left(starts, place + 1)
            ]:
                offset_ns = round((step + at - place) * period_ns)
                yield PlaybackEvent(offset_ns, NO_STEP, (message,), origin_ns=origin_ns)

    def without_step(self) -> list[tuple[float, tuple[int, int], int]]:
        """What belongs to no step, by its due time: the time, the message and its `origin_ns`."""
        transforms = len({*self._inputs(), *(each.input for each in self.between)})
        found = [(each.at, (each.input, each.position), 0) for each in self.between]
        found += [
            (each.at, (transforms, each.position), each.origin_ns) for each in self.transforms
        ]
        return sorted(found, key=lambda each: each[0])


class TimelineStep(msgspec.Struct, frozen=True, array_like=True):
    """A step of a recording: its recorded stamp, unique in the round, and its inputs as bits."""

    stamp_ns: int
    inputs: int


class TimelineMessage(msgspec.Struct, frozen=True, array_like=True):
    """A message of a recording, with its due time in a round.

    `step` is the number of its step in the round, or `NO_STEP` for transforms.
    """

    offset_ns: int
    step: int
    input: int
    position: int


class TimelineSchedule(msgspec.Struct, frozen=True, kw_only=True, tag="timeline"):
    """Steps with the times of a recording.

    Attributes:
        steps: in the order of their first messages, which are due at ascending times from 0.
        messages: in the order in which they are due.
        origin_ns: the recorded stamp that is shifted to the time at which the playback begins.
        period_ns: the duration of a round; longer than any offset.
        stamp_period_ns: the duration of a round in the recording.
        inputs: the number of inputs.
        shift_transforms: whether the stamps of transforms are also shifted.
        stamp_offsets_ns: for each step and input, the stamp of the message minus that of the step;
            empty if all are 0.
    """

    steps: tuple[TimelineStep, ...]
    messages: tuple[TimelineMessage, ...]
    origin_ns: int
    period_ns: int
    stamp_period_ns: int
    inputs: int
    shift_transforms: bool = True
    stamp_offsets_ns: tuple[tuple[int, ...], ...] = ()

    def due_offsets_ns(self) -> list[int]:
        """The due time of each step, relative to the beginning of the round."""
        found: dict[int, int] = {}
        for each in self.messages:
            if each.step != NO_STEP:
                found.setdefault(each.step, each.offset_ns)
        return [found[step] for step in range(len(self.steps))]

    def span_ns(self, rate_hz: float, steps: int) -> int:
        """How long so many steps take, up to when the one after them would be due."""
        del rate_hz
        rounds, rest = divmod(steps, len(self.steps))
        return rounds * self.period_ns + (self.due_offsets_ns()[rest] if rest else 0)

    def steps_within(self, rate_hz: float, duration_ns: int) -> int:
        """How many steps are due within a time."""
        del rate_hz
        rounds, rest_ns = divmod(duration_ns, self.period_ns)
        return rounds * len(self.steps) + bisect.bisect_left(self.due_offsets_ns(), rest_ns)

    def positions_used(self) -> list[set[int]]:
        """The positions that are played, for each input and then for the transforms."""
        columns: list[set[int]] = [set() for _ in range(self.inputs + 1)]
        for each in self.messages:
            columns[each.input].add(each.position)
        return columns

    def earliest_stamp_ns(self) -> int:
        """The first stamp relative to the beginning of the playback; usually negative or 0."""
        return min(each.stamp_ns for each in self.steps) - self.origin_ns

    def events(self, rate_hz: float, steps: int, first: int = 0) -> Iterator[PlaybackEvent]:
        """What to publish, in the order in which it is due.

        Each playback begins at the beginning of the recording, so that all are equal.

        Args:
            rate_hz: has no effect: the recording has its own times.
            steps: how many; the last message ends the last of them.
            first: has no effect.
        """
        del rate_hz, first
        sizes = [0] * len(self.steps)
        for each in self.messages:
            if each.step != NO_STEP:
                sizes[each.step] += 1
        left: dict[int, int] = {}
        closed = 0
        for turn in itertools.count():
            base, begin_ns = turn * len(self.steps), turn * self.period_ns
            stamps_ns = turn * self.stamp_period_ns - self.origin_ns
            for each in self.messages:
                if closed == steps:
                    return
                played = ((each.input, each.position),)
                offset_ns = begin_ns + each.offset_ns
                if each.step == NO_STEP:
                    yield PlaybackEvent(offset_ns, NO_STEP, played, stamp_ns=stamps_ns)
                    continue
                number = base + each.step
                if number >= steps:
                    continue
                starts_step = number not in left
                left[number] = left.get(number, sizes[each.step]) - 1
                ends_step = left[number] == 0
                closed += ends_step
                step = self.steps[each.step]
                stamp_ns = step.stamp_ns + stamps_ns
                offsets_ns = self.stamp_offsets_ns[each.step] if self.stamp_offsets_ns else ()
                yield PlaybackEvent(
                    offset_ns,
                    number,
                    played,
                    step.inputs,
                    stamp_ns,
                    0,
                    starts_step,
                    ends_step,
                    offsets_ns[each.input : each.input + 1],
                )


Schedule = CyclicSchedule | TimelineSchedule


def round_length_ns(times_ns: list[int]) -> int:
    """The duration of a round, from its first time to the first time of the next round.

    The recording does not contain it. The pause between two rounds is assumed to be the mean pause
    between two times: (t_last - t_first) n / (n - 1).

    Args:
        times_ns: ascending; at least one.
    """
    span_ns = times_ns[-1] - times_ns[0]
    if not span_ns:
        return 1_000_000_000
    return math.ceil(span_ns * len(times_ns) / (len(times_ns) - 1))
