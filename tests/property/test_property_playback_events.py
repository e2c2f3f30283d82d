"""The events of a player are those of its schedule, however long the playback is."""

from __future__ import annotations

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from nightly import size
from r2bspec.ipc import playback_file
from r2bspec.ipc.schedule import (
    BetweenMessage,
    CyclicSchedule,
    Schedule,
    TimelineMessage,
    TimelineSchedule,
    TimelineStep,
)
from schedule_events import expected_events, played_events

MESSAGES = 6
TIMES = st.integers(0, 10**10)
POSITIONS = st.integers(0, MESSAGES - 1)
SHIFTS = st.integers(-(10**9), 10**9)


@st.composite
def cyclic(draw: Any) -> CyclicSchedule:
    inputs = draw(st.integers(1, 3))
    length = draw(st.integers(1, 5))
    columns = draw(st.permutations(range(inputs)))[: draw(st.integers(1, inputs))]
    others = [each for each in range(inputs) if each not in columns]
    at = st.floats(0, length, exclude_max=True)
    rows = st.tuples(*[POSITIONS] * len(columns))
    between = [
        BetweenMessage(draw(at), other, draw(POSITIONS))
        for other in others
        for _ in range(draw(st.integers(1, 3)))
    ]
    shifts = st.tuples(*[SHIFTS] * len(columns))
    between += [
        BetweenMessage(draw(at), inputs, draw(POSITIONS), draw(TIMES))
        for _ in range(draw(st.integers(0, 3)))
    ]
    return CyclicSchedule(
        steps=tuple(draw(rows) for _ in range(length)),
        columns=tuple(columns),
        between=tuple(sorted(between, key=lambda message: message.at)),
        stamp_offsets_ns=tuple(draw(shifts) for _ in range(length)) if draw(st.booleans()) else (),
    )


@st.composite
def timelines(draw: Any) -> TimelineSchedule:
    inputs = draw(st.integers(1, 3))
    steps = draw(st.integers(1, 5))
    # Every step has a message, and steps may overlap.
    more = draw(st.lists(st.integers(-1, steps - 1), max_size=8))
    of_steps = draw(st.permutations([*range(steps), *more]))
    columns = st.integers(0, inputs - 1)
    times = sorted(draw(st.lists(TIMES, min_size=len(of_steps), max_size=len(of_steps))))
    messages = [
        TimelineMessage(time, step, inputs if step < 0 else draw(columns), draw(POSITIONS))
        for time, step in zip(times, of_steps, strict=True)
    ]
    shifts = st.tuples(*[SHIFTS] * inputs)
    return TimelineSchedule(
        steps=tuple(TimelineStep(draw(TIMES), draw(st.integers(1, 7))) for _ in range(steps)),
        messages=tuple(messages),
        origin_ns=draw(TIMES),
        period_ns=10**10 + 1,
        stamp_period_ns=draw(TIMES),
        inputs=inputs,
        shift_transforms=draw(st.booleans()),
        stamp_offsets_ns=tuple(draw(shifts) for _ in range(steps)) if draw(st.booleans()) else (),
    )


@given(
    schedule=st.one_of(cyclic(), timelines()),
    rate_hz=st.floats(0.1, 1e5),
    steps=st.integers(0, 12),
    first=st.integers(0, 4),
    block=st.sampled_from([1, 3, 1 << 18]),
)
@settings(max_examples=size(75, 300), deadline=None)
def test_the_events_are_those_of_the_schedule(
    schedule: Schedule, rate_hz: float, steps: int, first: int, block: int
) -> None:
    first %= len(schedule.steps)
    usual, playback_file._BLOCK = playback_file._BLOCK, block
    try:
        found = played_events(schedule, rate_hz, steps, first)
    finally:
        playback_file._BLOCK = usual
    assert found == expected_events(schedule, rate_hz, steps, first)
