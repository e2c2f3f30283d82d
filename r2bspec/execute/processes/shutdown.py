"""Ending processes: one after another, first asked, then told, then killed."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Sequence

from r2bspec.execute.processes.process import Child

ASKED_S = 10.0
"""How long a process that has been asked may take to end by itself."""

GRACE_S = 2.0
"""How long one may take after SIGTERM."""

_KILLED_S = 5.0
_POLL_S = 0.005


def end_in_turn(
    children: Sequence[Child], meanwhile: Callable[[], None], in_turn_s: float
) -> list[str]:
    """End some processes.

    Args:
        children: in the order in which they are to end.
        meanwhile: is called again and again while they are waited for.
        in_turn_s: how long processes are waited for one by one, all together; then the rest are
            asked at once (`Middleware.exit_in_turn_s`).

    Returns:
        The names of those that had to be killed.
    """
    began = time.monotonic()
    for child in children:
        child.ask_to_end()
        _wait_for([child], began + in_turn_s, meanwhile)
    _wait_for(children, began + ASKED_S, meanwhile)
    _signal_all(children, signal.SIGTERM)
    _wait_for(children, time.monotonic() + GRACE_S, meanwhile)
    killed = _signal_all(children, signal.SIGKILL)
    _wait_for(children, time.monotonic() + _KILLED_S, meanwhile)
    for child in children:
        # Grandchildren in the group that outlived their parent.
        child.signal(signal.SIGKILL)
    return killed


def _wait_for(children: Sequence[Child], deadline_s: float, meanwhile: Callable[[], None]) -> None:
    while any(child.runs for child in children) and time.monotonic() < deadline_s:
        meanwhile()
        time.sleep(_POLL_S)


def _signal_all(children: Sequence[Child], which: signal.Signals) -> list[str]:
    """Signal those that still run; returns their names."""
    running = [child for child in children if child.runs]
    for child in running:
        child.signal(which)
    return [child.name for child in running]
