"""Promise: a step of the system clock moves no time of a run, and is noticed."""

from __future__ import annotations

import pytest

from r2bspec.ipc.clocks import ClockOffsetTracker

MS = 1_000_000
HOUR = 3600 * 1000 * MS
EPOCH = 1_700_000_000 * 1000 * MS


class World:
    """Two clocks, of which the system's can be set; reading one takes some time."""

    def __init__(self) -> None:
        self.now = 50 * HOUR
        self.ahead = EPOCH
        self.reading = 100
        self.between: list[int] = []
        self.clocks = ClockOffsetTracker(self.monotonic, self.system)

    def monotonic(self) -> int:
        self.now += self.reading
        return self.now

    def system(self) -> int:
        self.now += self.reading
        value = self.now + self.ahead
        if self.between:
            self.now += self.between.pop(0)
        return value

    def receive(self) -> tuple[int, int]:
        """A message arrives: its time by the system clock, and really."""
        return self.now + self.ahead, self.now


@pytest.fixture
def world() -> World:
    return World()


def test_an_arrival_is_brought_to_the_monotonic_clock(world: World) -> None:
    stamp, really = world.receive()
    world.now += 3 * MS
    arrived, taken = world.clocks.arrival(stamp)
    assert abs(arrived - really) <= 2 * world.reading
    assert really + 3 * MS < taken <= world.now
    assert (world.clocks.steps, world.clocks.total_step_ns) == (0, 0)


def test_without_a_time_of_arrival_that_of_taking_is_used(world: World) -> None:
    arrived, taken = world.clocks.arrival(0)
    assert arrived == taken
    assert 0 <= world.now - taken <= 4 * world.reading


@pytest.mark.parametrize("step", [-HOUR, -50 * MS, 50 * MS, HOUR, 24 * 365 * HOUR])
def test_a_step_between_arrival_and_taking_moves_no_arrival(world: World, step: int) -> None:
    world.now += 20 * MS
    world.clocks.update()
    world.now += 2 * MS
    stamp, really = world.receive()
    world.now += MS
    world.ahead += step
    later_stamp, later = world.receive()
    world.now += MS
    arrived, taken = world.clocks.arrival(stamp)
    assert abs(arrived - really) <= MS
    assert arrived <= taken
    # Those that arrived after it are right, too, however many wait.
    for _ in range(3):
        arrived, _ = world.clocks.arrival(later_stamp)
        assert abs(arrived - later) <= MS
    assert world.clocks.steps == 1
    assert abs(world.clocks.total_step_ns - step) <= MS


@pytest.mark.parametrize("step", [-HOUR, HOUR])
def test_a_step_while_nothing_arrives_moves_nothing(world: World, step: int) -> None:
    world.now += 400 * MS
    world.ahead += step
    world.now += 100 * MS
    stamp, really = world.receive()
    world.now += MS
    arrived, _ = world.clocks.arrival(stamp)
    assert abs(arrived - really) <= MS


def test_several_steps_are_followed(world: World) -> None:
    for step in (HOUR, -2 * HOUR, 7 * HOUR):
        world.now += 10 * MS
        world.clocks.update()
        world.ahead += step
        stamp, really = world.receive()
        arrived, _ = world.clocks.arrival(stamp)
        assert abs(arrived - really) <= MS
    assert world.clocks.steps == 3
    assert abs(world.clocks.total_step_ns - 6 * HOUR) <= MS


def test_a_clock_that_is_slewed_is_no_step(world: World) -> None:
    for _ in range(1000):
        world.now += 10 * MS
        # 500 ppm is what the kernel slews by.
        world.ahead += 10 * MS * 500 // 1_000_000
        stamp, really = world.receive()
        arrived, _ = world.clocks.arrival(stamp)
        assert abs(arrived - really) <= MS // 10
    assert world.clocks.steps == 0


def test_an_interruption_between_reading_the_clocks_moves_no_arrival(world: World) -> None:
    # The process loses its processor for 30 ms after it has read the system clock.
    world.between = [30 * MS]
    stamp, really = world.receive()
    arrived, _ = world.clocks.arrival(stamp)
    assert abs(arrived - really) <= MS
    assert world.clocks.steps == 0


def test_no_message_arrives_after_it_was_taken(world: World) -> None:
    arrived, taken = world.clocks.arrival(world.now + world.ahead + MS)
    assert arrived == taken


def test_the_real_clocks_agree_with_themselves() -> None:
    import time

    clocks = ClockOffsetTracker()
    for _ in range(100):
        before = time.monotonic_ns()
        arrived, taken = clocks.arrival(time.time_ns())
        assert before - MS <= arrived <= taken <= time.monotonic_ns()
