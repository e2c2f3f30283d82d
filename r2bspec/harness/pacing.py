"""Waiting for a point in time: sleep most of the way, then spin.

A sleep ends late by the timer slack of the kernel and the time it takes to be scheduled; a spin
ends on time and costs a core. Sleeping to `SPIN_NS` before the goal and spinning from there gives
a start within a microsecond at the median for a few per cent of a core.
"""

from __future__ import annotations

import time
from collections.abc import Callable

SPIN_NS = 150_000
"""How much of a wait is spun: more than a sleep mostly oversleeps, yet cheap."""


def wait_until(due_ns: int, sleep: Callable[[float], bool]) -> bool:
    """Return at `due_ns` (CLOCK_MONOTONIC), or earlier if `sleep` was woken.

    Args:
        due_ns: when to return; a time in the past returns at once.
        sleep: sleeps for at most the given seconds and returns True if woken early.

    Returns:
        True if woken early.
    """
    while True:
        left_ns = due_ns - time.monotonic_ns()
        if left_ns <= SPIN_NS:
            break
        if sleep((left_ns - SPIN_NS) / 1e9):
            return True
    while time.monotonic_ns() < due_ns:
        pass
    return False
