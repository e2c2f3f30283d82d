"""A start has one deadline, whatever number of steps it takes."""

from __future__ import annotations

from r2bspec.execute.bringup.readiness import StartDeadline


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_every_step_of_a_start_has_what_the_earlier_ones_left() -> None:
    clock = Clock()
    deadline = StartDeadline(30 * 10**9, clock)
    assert deadline.left_s == 30.0
    clock.now_s += 20
    assert deadline.left_s == 10.0
    clock.now_s += 9
    assert (deadline.left_s, deadline.over) == (1.0, False)
    clock.now_s += 2
    assert (deadline.left_s, deadline.over) == (0.0, True)
    assert deadline.timeout_s == 30.0


def test_what_has_a_timeout_of_its_own_is_left_out() -> None:
    clock = Clock()
    deadline = StartDeadline(30 * 10**9, clock)
    clock.now_s += 10
    with deadline.paused():
        clock.now_s += 60
    assert deadline.left_s == 20.0
