"""Waiting for a point in time: sleep most of the way, then spin.

A sleep ends late by the timer slack of the kernel and the time it takes to be scheduled; a spin
ends on time and costs a core. How late sleeps end depends on the machine and on how long they are:
a core that was idle for ten milliseconds wakes more slowly than one that was idle for one. The
pacer therefore learns how much of a wait it must spin.
"""

from __future__ import annotations

import contextlib
import ctypes
import time
from collections.abc import Callable

INITIAL_SPIN_NS = 150_000
"""How much of a wait is spun until more is known: more than most sleeps end late."""

_MIN_SPIN_NS = 30_000
_MAX_SPIN_NS = 300_000
"""Beyond that it is no longer the timer but other work that holds a core, which no spin helps."""

_MAX_LATE_SHARE = 0.04
"""Of all sleeps, those that may end after the due time."""

_STEP_NS = 4_000

_PR_SET_TIMERSLACK = 29


class Pacer:
    """Waits again and again, and learns how late sleeps end.

    `spin_ns` follows the (1 - `_MAX_LATE_SHARE`) quantile of how late they do: a step up when one
    ended after its due time, a small one down when it did not, in the ratio that balances there.
    Belongs to the thread that makes it.
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
    """Let the kernel end this thread's sleeps on time: by default it may be 50 us late."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
