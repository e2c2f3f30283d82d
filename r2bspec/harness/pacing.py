"""Waiting until a time: sleep for most of it, then spin.

A sleep ends late by the timer slack of the kernel and the scheduling latency; a spin ends on time
but uses a core. The lateness of sleeps depends on the machine and on their length: a core that was
idle for ten milliseconds wakes more slowly than one that was idle for one. The pacer therefore
learns for how long it must spin.
"""

from __future__ import annotations

import contextlib
import ctypes
import time
from collections.abc import Callable

INITIAL_SPIN_NS = 150_000
"""The initial spin time: more than the lateness of most sleeps."""

_MIN_SPIN_NS = 30_000
_MAX_SPIN_NS = 300_000
"""A larger lateness is not caused by the timer but by other work on the core; spinning does not
help against it."""

_MAX_LATE_SHARE = 0.04
"""The share of sleeps that may end after the due time."""

_STEP_NS = 4_000

_PR_SET_TIMERSLACK = 29


class Pacer:
    """Waits for due times, and learns the lateness of sleeps.

    `spin_ns` follows the (1 - `_MAX_LATE_SHARE`) quantile of the lateness: it takes a step up when
    a sleep ended after its due time, and a small one down when it did not, in the ratio that is in
    balance at this quantile. For use in the thread that creates it.
    """

    def __init__(self) -> None:
        self.spin_ns = INITIAL_SPIN_NS
        _minimise_timer_slack()

    def wait_until(self, due_ns: int, sleep: Callable[[float], bool]) -> bool:
        """Return at `due_ns` (CLOCK_MONOTONIC), or earlier if `sleep` was woken.

        Args:
            due_ns: when to return; a time in the past returns at once.
            sleep: sleeps for at most the given seconds and returns True if woken early.

        Returns:
            True if woken early.
        """
        slept = False
        while (left_ns := due_ns - time.monotonic_ns()) > self.spin_ns:
            if sleep((left_ns - self.spin_ns) / 1e9):
                return True
            slept = True
        if slept:
            self._learn(late=left_ns <= 0)
        while time.monotonic_ns() < due_ns:
            pass
        return False

    def _learn(self, *, late: bool) -> None:
        change_ns = round(_STEP_NS * ((1 - _MAX_LATE_SHARE) if late else -_MAX_LATE_SHARE))
        self.spin_ns = min(max(self.spin_ns + change_ns, _MIN_SPIN_NS), _MAX_SPIN_NS)


def _minimise_timer_slack() -> None:
    """Minimise the timer slack of this thread, which is 50 us by default."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
