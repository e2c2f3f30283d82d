"""A harness process with techniques left out, to see what each of them gains.

Started by `floor_harness` in the place of ``python -m r2bspec.harness.child``.
"""

from __future__ import annotations

import os
import sys
from typing import Any

WITHOUT_VARIABLE = "FLOOR_WITHOUT"

_VARIABLES = {
    "allocator": ("MALLOC_MMAP_MAX_", "MALLOC_TRIM_THRESHOLD_", "MALLOC_TOP_PAD_"),
    "huge-pages": ("GLIBC_TUNABLES",),
}
"""Techniques that are in the environment, and have to be before the process starts."""


def _without_rcl() -> None:
    from r2bspec.harness import rcl_calls

    rcl_calls.__dict__["_library"] = lambda: None


def _without_exact_timers() -> None:
    from r2bspec.harness import pacing

    pacing.__dict__["_minimise_timer_slack"] = lambda: None


def _without_spin() -> None:
    from r2bspec.harness import pacing

    pacing.__dict__["INITIAL_SPIN_NS"] = 0
    pacing.__dict__["_MIN_SPIN_NS"] = 0
    pacing.__dict__["_MAX_SPIN_NS"] = 0


def _without_learning() -> None:
    from r2bspec.harness.pacing import Pacer

    type.__setattr__(Pacer, "_learn", lambda _self, **_late: None)


def _without_early_stamps() -> None:
    from r2bspec.harness import player

    class Late(player.Player):
        def _stamp(self, held: Any, event: Any, due_ns: int, epoch_ns: int) -> int:
            self._late = (held, event, due_ns, epoch_ns)
            return 0

        def _publish(self, held: Any, event: Any) -> tuple[int, int]:
            super()._stamp(*self._late)
            return super()._publish(held, event)

    player.__dict__["Player"] = Late


_TECHNIQUES: dict[str, Any] = {
    "rcl": _without_rcl,
    "exact-timers": _without_exact_timers,
    "spin": _without_spin,
    "learning": _without_learning,
    "early-stamps": _without_early_stamps,
} | dict.fromkeys(_VARIABLES, lambda: None)

TECHNIQUES = tuple(_TECHNIQUES)


def leave_out() -> None:
    """Undo the techniques that the environment names."""
    named = [each for each in os.environ.get(WITHOUT_VARIABLE, "").split(",") if each]
    unwanted = {name for each in named for name in _VARIABLES.get(each, ())}
    if unwanted & set(os.environ):
        rest = {name: value for name, value in os.environ.items() if name not in unwanted}
        os.execve(sys.executable, [sys.executable, *sys.argv], rest)  # noqa: S606
    for each in named:
        _TECHNIQUES[each]()


if __name__ == "__main__":
    leave_out()
    from r2bspec.harness import child

    status = child.main()
    if "rclpy" in sys.modules:
        from r2bspec.harness import rclpy_tools

        rclpy_tools.finish()
    os._exit(status)
