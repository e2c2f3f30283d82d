"""Waiting for a point in time: sleep most of the way, then spin.

A sleep ends late by the timer slack of the kernel and the time it takes to be scheduled; a spin
ends on time and costs a core.
"""

from __future__ import annotations

import contextlib
import ctypes
import time
from collections.abc import Callable

SPIN_NS = 150_000
"""How much of a wait is spun: more than most sleeps end late."""

_PR_SET_TIMERSLACK = 29


class Pacer:
    """Waits again and again. Belongs to the thread that makes it."""

    def __init__(self) -> None:
        _minimise_timer_slack()

    def wait_until(self, due_ns: int, sleep: Callable[[float], bool]) -> bool:
        """Return at `due_ns` (CLOCK_MONOTONIC), or earlier if `sleep` was woken.

        Args:
            due_ns: when to return; a time in the past returns at once.
            sleep: sleeps for at most the given seconds and returns True if woken early.

        Returns:
            True if woken early.
        """
        while (left_ns := due_ns - time.monotonic_ns()) > SPIN_NS:
            if sleep((left_ns - SPIN_NS) / 1e9):
                return True
        while time.monotonic_ns() < due_ns:
            pass
        return False


def _minimise_timer_slack() -> None:
    """Let the kernel end this thread's sleeps on time: by default it may be 50 us late."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
