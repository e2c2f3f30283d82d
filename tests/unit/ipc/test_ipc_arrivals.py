"""Promise: a step of the system clock is noticed, moves no arrival, and is one."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from r2bspec.ipc.sample_files import ARRIVAL_FIELDS, ArrivalReader, RowWriter, arrival_times
from r2bspec.record.sample_arrays import MONITOR_FIELDS

MS = 1_000_000
HOUR = 3600 * 1000 * MS
EPOCH = 1_700_000_000 * 1000 * MS


class World:
    """Two clocks, of which the system's can be set, and a monitor that takes messages."""

    def __init__(self) -> None:
        self.now = 50 * HOUR
        self.ahead = EPOCH
        self.really: list[int] = []
        self.rows: list[tuple[int, int, int, int, int]] = []
        self._waiting: list[int] = []

    def receive(self) -> None:
        """A message arrives, and waits."""
        self.really.append(self.now)
        self._waiting.append(self.now + self.ahead)

    def take(self) -> None:
        """The monitor takes all that wait."""
        for arrived in self._waiting:
            self.now += 1000
            self.rows.append((0, arrived, self.now, 8, self.ahead))
        self._waiting.clear()

    def found(self) -> list[int]:
        times: list[int] = arrival_times(np.array(self.rows, list(ARRIVAL_FIELDS))).tolist()
        return times


@pytest.fixture
def world() -> World:
    """It has taken a message already."""
    made = World()
    made.receive()
    made.take()
    made.now += 20 * MS
    return made


STEPS = [-HOUR, -50 * MS, 50 * MS, HOUR, 24 * 365 * HOUR]


@pytest.mark.parametrize("step", STEPS)
def test_a_step_between_arrival_and_taking_moves_no_arrival(world: World, step: int) -> None:
    for _ in range(3):
        world.receive()
        world.now += MS
    world.ahead += step
    # Those that arrived after it are right, too, however many wait.
    for _ in range(3):
        world.now += MS
        world.receive()
    world.take()
    world.now += 5 * MS
    world.receive()
    world.take()
    assert world.found() == world.really


def test_a_clock_that_is_slewed_is_no_step(world: World) -> None:
    # 500 ppm is what the kernel slews by; messages wait for 1 ms.
    for _ in range(1000):
        world.now += 9 * MS
        world.receive()
        world.now += MS
        world.ahead += 10 * MS * 500 // 1_000_000
        world.take()
    off = np.subtract(world.found(), world.really)
    assert np.abs(off).max() <= 10 * MS * 500 // 1_000_000


def test_no_message_arrives_after_it_was_taken(world: World) -> None:
    taken = world.now
    world.rows.append((0, taken + world.ahead + MS, taken, 8, world.ahead))
    assert world.found()[-1] == taken


def test_without_a_time_of_the_middleware_that_of_taking_is_used(world: World) -> None:
    world.rows.append((0, 0, world.now, 8, world.ahead))
    world.ahead += HOUR
    world.rows.append((0, 0, world.now + MS, 8, world.ahead))
    assert world.found()[-2:] == [world.now, world.now + MS]


def test_a_reader_of_the_last_rows_knows_a_step_before_them(tmp_path: Path, world: World) -> None:
    for _ in range(50):
        world.receive()
        world.now += 1000
    world.ahead += HOUR
    world.take()
    path = tmp_path / "out.rows"
    with closing(RowWriter(path, len(ARRIVAL_FIELDS))) as rows:
        for row in world.rows:
            rows.append(*row)
        reader = ArrivalReader(path, MONITOR_FIELDS)
        assert reader.count() == 51
        for start, stop in ((0, None), (1, None), (40, None), (40, 45), (51, None), (60, None)):
            found = reader.read(start, stop)
            assert found.dtype == np.dtype(list(MONITOR_FIELDS))
            assert found["received_ns"].tolist() == world.really[start:stop]
            assert found["bytes"].tolist() == [8] * len(world.really[start:stop])
    assert ArrivalReader(tmp_path / "none", MONITOR_FIELDS).read().size == 0
