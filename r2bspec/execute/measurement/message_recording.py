"""Recording whole messages during one iteration, by the observer.

Copying messages takes time from the machine, so that nothing of this iteration is timed.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from r2bspec.execute.processes.supervisor import ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.plan.plan import MonitorPlan

_REPLY_TIMEOUT_S = 10.0
_MATCH_TIMEOUT_S = 5.0
_POLL_S = 0.05


class MessageRecording:
    """A second subscription to some topics, from `begin` to `end`.

    Args:
        supervisor: all processes.
        monitors: the topics, with the names of their files.
        folder: receives the files.
    """

    def __init__(
        self, supervisor: ProcessSupervisor, monitors: Sequence[MonitorPlan], folder: Path
    ) -> None:
        self._supervisor = supervisor
        self._monitors = tuple(monitors)
        self._folder = folder

    def begin(self) -> None:
        """Subscribe, and wait until the publishers are found; some topics may have none.

        Raises:
            RunError: a process does not respond, or exited.
        """
        self._ask(protocol.Record(monitors=self._monitors, folder=str(self._folder)))
        deadline = time.monotonic() + _MATCH_TIMEOUT_S
        while time.monotonic() < deadline:
            found = self._ask(protocol.CountMatches())
            if all(found.counts.get(each.topic) for each in self._monitors):
                return
            self._supervisor.pump(_POLL_S)

    def end(self) -> None:
        """Unsubscribe; the files are complete when this returns.

        Raises:
            RunError: a process does not respond, or the messages could not be written.
        """
        self._ask(protocol.EndRecording())

    def _ask(self, message: Any) -> protocol.Matched:
        observer = self._supervisor.observer()
        return self._supervisor.request(observer, message, protocol.Matched, _REPLY_TIMEOUT_S)
