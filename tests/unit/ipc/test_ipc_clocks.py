"""Promise: a step of the system clock is noticed."""

from __future__ import annotations

import time

import pytest

from r2bspec.ipc.arrivals import ClockOffsetTracker, read_clocks

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


@pytest.fixture
def world() -> World:
    return World()


@pytest.mark.parametrize("step", [-HOUR, -50 * MS, 50 * MS, HOUR, 24 * 365 * HOUR])
def test_a_step_is_noticed_once(world: World, step: int) -> None:
    for _ in range(3):
        world.now += 20 * MS
        world.clocks.update()
    assert (world.clocks.steps, world.clocks.total_step_ns) == (0, 0)
    world.ahead += step
    for _ in range(3):
        world.now += 20 * MS
        world.clocks.update()
    assert world.clocks.steps == 1
    assert abs(world.clocks.total_step_ns - step) <= MS


def test_several_steps_are_followed(world: World) -> None:
    for step in (HOUR, -2 * HOUR, 7 * HOUR):
        world.now += 10 * MS
        world.clocks.update()
        world.ahead += step
        world.clocks.update()
    assert world.clocks.steps == 3
    assert abs(world.clocks.total_step_ns - 6 * HOUR) <= MS


def test_a_clock_that_is_slewed_is_no_step(world: World) -> None:
    for _ in range(1000):
        world.now += 10 * MS
        # 500 ppm is what the kernel slews by.
        world.ahead += 10 * MS * 500 // 1_000_000
        world.clocks.update()
    assert world.clocks.steps == 0


def test_an_interruption_between_reading_the_clocks_is_no_step(world: World) -> None:
    # The process loses its processor for 30 ms after it has read the system clock.
    world.between = [30 * MS]
    world.clocks.update()
    assert world.clocks.steps == 0


def test_the_real_clocks_agree_with_themselves() -> None:
    for _ in range(100):
        before = time.monotonic_ns()
        now_ns, difference_ns = read_clocks()
        stamp_ns = time.time_ns()
        assert before <= now_ns <= time.monotonic_ns()
        assert abs(stamp_ns - difference_ns - now_ns) <= time.monotonic_ns() - before + MS
