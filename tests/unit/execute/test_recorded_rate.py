"""Promise: an input with a rate of its own keeps its number of messages for each step."""

from __future__ import annotations

import pytest

from r2bspec.execute.build_schedule import place_between
from r2bspec.execute.errors import RunError
from r2bspec.ipc.buffers import BufferIndex
from r2bspec.ipc.schedule import CyclicSchedule
from schedule_events import played_events


def recorded(topic: str, *stamps_ns: int) -> BufferIndex:
    return BufferIndex(
        topic=topic,
        type="sensor_msgs/msg/Imu",
        has_header=True,
        stamps_ns=stamps_ns,
        sizes=(100,) * len(stamps_ns),
        times_ns=tuple(stamp + 7 for stamp in stamps_ns),
    )


CAMERA = recorded("/camera", 0, 100, 200)
STEPS = ((0,), (1,), (2,))


def test_each_message_is_played_where_it_was_stamped() -> None:
    imu = recorded("/imu", 25, 75, 100, 150, 250, 350)
    placed = place_between(1, imu, STEPS, [CAMERA])
    # 350 is later than a mean period after the last step.
    assert [(each.at, each.position) for each in placed] == [
        (0.25, 0),
        (0.75, 1),
        (1.0, 2),
        (1.5, 3),
        (2.5, 4),
    ]


def test_a_step_input_may_come_after_one_with_its_own_rate() -> None:
    imu = recorded("/imu", 25, 75)
    schedule = CyclicSchedule(
        steps=STEPS, columns=(1,), between=place_between(0, imu, STEPS, [CAMERA])
    )
    first, second = played_events(schedule, 10.0, 1)[:2]
    assert first.messages == ((1, 0, 0),)
    assert first.inputs == 2
    assert second.messages == ((0, 0, 0),)


def test_an_input_on_another_clock_is_refused() -> None:
    with pytest.raises(RunError, match="no message of /imu was recorded between the steps"):
        place_between(1, recorded("/imu", 5000, 6000), STEPS, [CAMERA])
