"""Waiting for a due time: what is slept, what is spun, and what ends it."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

from r2bspec.harness.pacing import SPIN_NS, Pacer


def wait_until(due_ns: int, sleep: Callable[[float], bool]) -> bool:
    return Pacer().wait_until(due_ns, sleep)


class Clock:
    """A clock that advances by what is slept, and by a little each time it is read."""

    def __init__(self, tick_ns: int = 1_000) -> None:
        self.now_ns = 0
        self.slept_s: list[float] = []
        self._tick_ns = tick_ns

    def monotonic_ns(self) -> int:
        self.now_ns += self._tick_ns
        return self.now_ns

    def sleep(self, seconds: float) -> bool:
        self.slept_s.append(seconds)
        self.now_ns += round(seconds * 1e9)
        return False


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr(time, "monotonic_ns", found.monotonic_ns)
    return found


def test_it_sleeps_most_of_the_way_and_spins_the_rest(clock: Clock) -> None:
    assert wait_until(10_000_000, clock.sleep) is False
    assert clock.slept_s == [pytest.approx((10_000_000 - SPIN_NS) / 1e9, rel=1e-3)]
    assert 10_000_000 <= clock.now_ns < 10_002_000


def test_a_sleep_that_ends_early_is_slept_again(clock: Clock) -> None:
    def short(seconds: float) -> bool:
        return clock.sleep(seconds / 2)

    assert wait_until(10_000_000, short) is False
    assert len(clock.slept_s) > 2
    assert clock.now_ns >= 10_000_000


def test_a_time_in_the_past_is_not_waited_for(clock: Clock) -> None:
    clock.now_ns = 50_000_000
    assert wait_until(10_000_000, clock.sleep) is False
    assert clock.slept_s == []


def test_a_short_wait_is_spun_only(clock: Clock) -> None:
    assert wait_until(SPIN_NS, clock.sleep) is False
    assert clock.slept_s == []
    assert clock.now_ns >= SPIN_NS


def test_being_woken_ends_the_wait_before_its_time(clock: Clock) -> None:
    assert wait_until(10_000_000, lambda _seconds: True) is True
    assert clock.now_ns < 10_000_000


def really_sleep(seconds: float) -> bool:
    time.sleep(seconds)
    return False


def test_it_never_returns_before_the_due_time_on_the_real_clock() -> None:
    due_ns = time.monotonic_ns()
    for _ in range(20):
        due_ns += 700_000
        assert wait_until(due_ns, really_sleep) is False
        assert time.monotonic_ns() >= due_ns
