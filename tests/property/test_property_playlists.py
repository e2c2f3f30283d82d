"""The native player expands every schedule to the same events as Python."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

pytest.importorskip("rclpy")

from native_playlists import PlaylistReader, expected_events, playlist_reader
from r2bspec.ipc.buffers import BufferWriter
from r2bspec.ipc.playlist import write_playlist
from r2bspec.ipc.schedule import (
    BetweenMessage,
    CyclicSchedule,
    CyclicTransform,
    Schedule,
    TimelineMessage,
    TimelineSchedule,
    TimelineStep,
)
from r2bspec.ipc.transform_stamps import TF, TF_TYPE

MESSAGES = 6
TRANSFORM_BYTES = 92
SIZES = {"/a": 8, "/b": 12, "/c": 20}
TIMES = st.integers(0, 10**10)
POSITIONS = st.integers(0, MESSAGES - 1)
SHIFTS = st.integers(-(10**9), 10**9)


@pytest.fixture(scope="module")
def buffers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("buffers")
    transform = b"\0\1\0\0" + struct.pack("<I", 1) + struct.pack("<iI", 5, 7)
    transform += 2 * (struct.pack("<I", 2) + b"m\0\0\0") + b"\0" * 4 + b"\0" * 56
    for topic in (*SIZES, TF):
        writer = BufferWriter(folder, topic, TF_TYPE, has_header=True)
        for number in range(MESSAGES):
            writer.append(number, transform if topic == TF else bytes(SIZES[topic]))
        writer.close()
    return folder


@pytest.fixture(scope="module")
def reader() -> Iterator[PlaylistReader]:
    with PlaylistReader(playlist_reader()) as made:
        yield made


@st.composite
def cyclic(draw: Any) -> tuple[CyclicSchedule, list[str]]:
    inputs = draw(st.integers(1, 3))
    length = draw(st.integers(1, 5))
    columns = draw(st.permutations(range(inputs)))[: draw(st.integers(1, inputs))]
    others = [each for each in range(inputs) if each not in columns]
    at = st.floats(0, length, exclude_max=True)
    rows = st.tuples(*[POSITIONS] * len(columns))
    between = [
        BetweenMessage(draw(at), each, draw(POSITIONS))
        for each in others
        for _ in range(draw(st.integers(1, 3)))
    ]
    shifts = st.tuples(*[SHIFTS] * len(columns))
    schedule = CyclicSchedule(
        steps=tuple(draw(rows) for _ in range(length)),
        columns=tuple(columns),
        between=tuple(between),
        transforms=tuple(
            CyclicTransform(draw(at), draw(POSITIONS), draw(TIMES))
            for _ in range(draw(st.integers(0, 3)))
        ),
        stamp_offsets_ns=tuple(draw(shifts) for _ in range(length)) if draw(st.booleans()) else (),
    )
    return schedule, [*SIZES][:inputs]


@st.composite
def timelines(draw: Any) -> tuple[TimelineSchedule, list[str]]:
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
    schedule = TimelineSchedule(
        steps=tuple(TimelineStep(draw(TIMES), draw(st.integers(1, 7))) for _ in range(steps)),
        messages=tuple(messages),
        origin_ns=draw(TIMES),
        period_ns=10**10 + 1,
        stamp_period_ns=draw(TIMES),
        inputs=inputs,
        shift_transforms=draw(st.booleans()),
        stamp_offsets_ns=tuple(draw(shifts) for _ in range(steps)) if draw(st.booleans()) else (),
    )
    return schedule, [*SIZES][:inputs]


@given(
    made=st.one_of(cyclic(), timelines()),
    rate_hz=st.floats(0.1, 1e5),
    steps=st.integers(0, 12),
    first=st.integers(0, 4),
)
@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_the_events_are_those_of_python(
    buffers: Path,
    reader: PlaylistReader,
    made: tuple[Schedule, list[str]],
    rate_hz: float,
    steps: int,
    first: int,
) -> None:
    schedule, topics = made
    first %= len(schedule.steps)
    path = buffers / "playlist"
    write_playlist(path, schedule, topics, buffers)
    offsets = [[0, *itertools.accumulate([SIZES[topic]] * (MESSAGES - 1))] for topic in topics]
    offsets.append([TRANSFORM_BYTES * number for number in range(MESSAGES)])
    lines, last = reader.read(path, len(topics) + 1, rate_hz, steps, first=first)
    assert last == "end"
    assert lines == expected_events(schedule, offsets, rate_hz, steps, first)
