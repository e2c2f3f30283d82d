"""Schedules of playback, which the controller builds and the player executes.

A schedule is one round of steps, which is repeated. A step consists of the messages with one header
stamp, or with stamps that the spec allows to differ. There are two kinds:

`CyclicSchedule` has no times: the messages of a step are due together, the steps follow each other
at the requested rate, and the stamp of a step is the time at which it is due.

`TimelineSchedule` has the times of a recording: each message has its own due time. A step is due
with its first message. The stamps of a round are those of the recording, shifted by one constant,
so that they stay consistent with each other; each round shifts them further by the recorded length
of a round, so that no stamp is repeated.

What is published when is computed by `r2bspec.ipc.playback_file`.

Transforms can be played with both, and in a cyclic schedule the messages of inputs with a rate of
their own. They belong to no step and do not count as steps; in a cyclic schedule those that are due
with a step are published with it, and have its stamp.
"""

from __future__ import annotations

import bisect
import math

import msgspec

NO_STEP = -1
"""The step of messages that belong to none."""

ALL_INPUTS = -1
"""The set of all inputs, as bits."""


class BetweenMessage(msgspec.Struct, frozen=True, array_like=True):
    """A message that is played between two steps: of an input with a rate of its own, or of /tf.

    Attributes:
        at: the due time, in steps from the beginning of the round. The stamp is this time.
        input: the number of the input in the plan; transforms come after all inputs.
        position: the position of the message in its buffer.
        origin_ns: of transforms, the recorded time that corresponds to `at`, on the clock of
            header stamps.
    """

    at: float
    input: int
    position: int
    origin_ns: int = 0


class CyclicSchedule(msgspec.Struct, frozen=True, kw_only=True, tag="cyclic"):
    """Steps without times.

    Attributes:
        steps: ``steps[i][k]`` is the position of the message of step i in input ``columns[k]``.
        columns: the inputs of the steps, by their numbers in the plan; empty for all of them.
        between: messages of the other inputs, and transforms, by their due times.
        stamp_offsets_ns: for each step and column, the stamp of the message minus that of the
            step; empty if all are 0.
    """

    steps: tuple[tuple[int, ...], ...]
    columns: tuple[int, ...] = ()
    between: tuple[BetweenMessage, ...] = ()
    stamp_offsets_ns: tuple[tuple[int, ...], ...] = ()

    def span_ns(self, rate_hz: float, steps: int) -> int:
        """Return how long `steps` steps take, up to when the following step would be due."""
        return round(steps * 1e9 / rate_hz)

    def steps_within(self, rate_hz: float, duration_ns: int) -> int:
        """Return how many steps are due within a time."""
        return round(duration_ns / 1e9 * rate_hz)


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
        """Return the due time of each step, relative to the beginning of the round."""
        offsets_ns: dict[int, int] = {}
        for message in self.messages:
            if message.step != NO_STEP:
                offsets_ns.setdefault(message.step, message.offset_ns)
        return [offsets_ns[step] for step in range(len(self.steps))]

    def message_of(self, step: int) -> TimelineMessage:
        """Return the message of a step of any round, with its due time; each step must have one."""
        turns, place = divmod(step, len(self.steps))
        message = self.messages[place]
        return msgspec.structs.replace(
            message, offset_ns=turns * self.period_ns + message.offset_ns
        )

    def span_ns(self, rate_hz: float, steps: int) -> int:
        """Return how long `steps` steps take, up to when the following step would be due."""
        del rate_hz
        rounds, rest = divmod(steps, len(self.steps))
        return rounds * self.period_ns + (self.due_offsets_ns()[rest] if rest else 0)

    def steps_within(self, rate_hz: float, duration_ns: int) -> int:
        """Return how many steps are due within a time."""
        del rate_hz
        rounds, rest_ns = divmod(duration_ns, self.period_ns)
        return rounds * len(self.steps) + bisect.bisect_left(self.due_offsets_ns(), rest_ns)


Schedule = CyclicSchedule | TimelineSchedule


class Turns(msgspec.Struct, frozen=True):
    """When a side of a comparison is played, in turns with the other side.

    Attributes:
        begin_ns: when the first pair of steps begins, on the monotonic clock.
        pair_hz: pairs of steps per second.
        delays_ns: of each step of this side, after the beginning of its pair.
        core: on which the graphs of both sides run meanwhile; None for all that they may use.
    """

    begin_ns: int
    pair_hz: float
    delays_ns: tuple[int, ...]
    core: int | None = None


def round_length_ns(times_ns: list[int]) -> int:
    """Return the duration of a round, from its first time to the first time of the next round.

    The recording does not contain it. The pause between two rounds is assumed to be the mean pause
    between two times: (t_last - t_first) n / (n - 1).

    Args:
        times_ns: ascending; at least one.
    """
    span_ns = times_ns[-1] - times_ns[0]
    if not span_ns:
        return 1_000_000_000
    return math.ceil(span_ns * len(times_ns) / (len(times_ns) - 1))
