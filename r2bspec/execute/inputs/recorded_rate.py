"""Placing the messages of inputs with a rate of their own between the steps.

Between two steps they are distributed as in the recording: a message that was stamped at a third of
the interval is played at a third of it, at any rate of the steps. So an IMU of 200 Hz played with a
camera of 30 Hz keeps its number of messages for each image.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterator, Sequence

from r2bspec.execute.errors import RunError
from r2bspec.ipc.buffers import BufferIndex
from r2bspec.ipc.schedule import BetweenMessage, round_length_ns


def place_between(
    number: int, index: BufferIndex, steps: Sequence[tuple[int, ...]], inputs: Sequence[BufferIndex]
) -> tuple[BetweenMessage, ...]:
    """The messages of one input between the steps of a round.

    Where it and an input of the steps have headers, their stamps are compared, otherwise the times
    of recording. What was recorded outside of the steps is left out, but for a mean period after
    the last one.

    Args:
        number: of the input in the plan.
        index: its buffer.
        steps: one round.
        inputs: the buffers of the inputs of the steps.

    Raises:
        RunError: no message was recorded between the steps.
    """
    headers = [each for each in inputs if each.has_header] if index.has_header else []
    times_ns = index.stamps_ns if headers else index.times_ns
    by_time = sorted(range(len(times_ns)), key=lambda position: times_ns[position])
    ordered = [times_ns[position] for position in by_time]
    found = [
        BetweenMessage(
            step + (ordered[place] - from_ns) / (to_ns - from_ns), number, by_time[place]
        )
        for step, from_ns, to_ns in step_intervals(_step_times(steps, inputs, bool(headers)))
        for place in range(
            bisect.bisect_left(ordered, min(from_ns, to_ns)),
            bisect.bisect_left(ordered, max(from_ns, to_ns)),
        )
        if ordered[place] != to_ns
    ]
    if not found:
        raise RunError(
            f"no message of {index.topic} was recorded between the steps of the other inputs",
            hint="Check the window, and that the stamps of all inputs are on one clock.",
            code="R2B644",
        )
    return tuple(sorted(found, key=lambda each: each.at))


def step_intervals(times_ns: Sequence[int]) -> Iterator[tuple[int, int, int]]:
    """The number of each step of a round, its time, and that of the next one.

    The last interval of a round that only goes forwards is as long as the mean one.
    """
    different = sorted(set(times_ns))
    period_ns = round_length_ns(different) // len(different)
    for number, from_ns in enumerate(times_ns):
        to_ns = times_ns[(number + 1) % len(times_ns)]
        last = number + 1 == len(times_ns)
        if last and to_ns <= from_ns and len(different) == len(times_ns):
            to_ns = from_ns + period_ns
        if to_ns != from_ns:
            yield number, from_ns, to_ns


def _step_times(
    steps: Sequence[tuple[int, ...]], inputs: Sequence[BufferIndex], stamps: bool
) -> list[int]:
    return [
        max(
            index.stamps_ns[position] if stamps else index.times_ns[position]
            for index, position in zip(inputs, step, strict=True)
            if index.has_header or not stamps
        )
        for step in steps
    ]
