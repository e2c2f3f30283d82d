"""Ending processes one after another: by request, then with SIGTERM, then with SIGKILL."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Sequence

from r2bspec.execute.processes.process import ManagedProcess
from r2bspec.ipc.process_cleanup import kill_process_groups

MAX_EXIT_S = 10.0
"""How long a process may take to exit after the request."""

MAX_SIGTERM_S = 2.0
"""How long a process may take to exit after SIGTERM."""

_MAX_SIGKILL_S = 5.0
_POLL_S = 0.005


def end_sequentially(
    processes: Sequence[ManagedProcess], on_poll: Callable[[], None], in_turn_s: float
) -> list[str]:
    """End some processes.

    Args:
        processes: in the order in which to end them.
        on_poll: is called repeatedly while waiting.
        in_turn_s: how long processes are waited for one by one, all together; then the rest are
            asked at once (`Middleware.exit_in_turn_s`).

    Returns:
        The names of those that had to be killed.
    """
    began = time.monotonic()
    for child in processes:
        child.request_shutdown()
        _wait_for([child], began + in_turn_s, on_poll)
    _wait_for(processes, began + MAX_EXIT_S, on_poll)
    _signal_all(processes, signal.SIGTERM)
    _wait_for(processes, time.monotonic() + MAX_SIGTERM_S, on_poll)
    killed = _signal_all(processes, signal.SIGKILL)
    _wait_for(processes, time.monotonic() + _MAX_SIGKILL_S, on_poll)
    # Grandchildren in the group that outlived their parent.
    kill_process_groups([child.session for child in processes])
    return killed


def _wait_for(
    processes: Sequence[ManagedProcess], deadline_s: float, on_poll: Callable[[], None]
) -> None:
    while any(child.is_running for child in processes) and time.monotonic() < deadline_s:
        on_poll()
        time.sleep(_POLL_S)


def _signal_all(processes: Sequence[ManagedProcess], which: signal.Signals) -> list[str]:
    """Send a signal to those that still run; returns their names."""
    running = [child for child in processes if child.is_running]
    for child in running:
        child.signal(which)
    return [child.name for child in running]
