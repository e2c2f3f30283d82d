"""The player and the monitor, and the processes in which they run.

A plan gives player and monitor a process each, or one for both (role `harness`), in which Python
nodes may also run. The rest of the controller addresses a part and does not know its process.
"""

from __future__ import annotations

from collections.abc import Iterable

from r2bspec.execute.bringup.launcher import Launcher
from r2bspec.execute.processes.supervisor import ManagedProcess
from r2bspec.ipc import protocol
from r2bspec.plan.plan import ProcessPlan

_PARTS = ("player", "monitor")


class HarnessProcesses:
    """Starts each part, and its process if necessary, on request.

    Args:
        launcher: starts the processes.
        processes: the process plans of one phase.
    """

    def __init__(self, launcher: Launcher, processes: Iterable[ProcessPlan]) -> None:
        self._launcher = launcher
        self._plans = {each.role: each for each in processes if each.role in {*_PARTS, "harness"}}
        self._process: ManagedProcess | None = None

    def start(self, part: str) -> ManagedProcess:
        """Start a part, which then waits for its configuration.

        Raises:
            RunError: its process cannot be started, or does not respond.
        """
        if part in self._plans:
            return self._launcher.start(self._plans[part])
        return self._harness_process().parts[part]

    def node_hosts(self) -> list[tuple[ManagedProcess, ProcessPlan]]:
        """The common process of the parts, with its plan, if nodes run in it; else nothing."""
        plan = self._plans.get("harness")
        return [(self._harness_process(), plan)] if plan is not None and plan.nodes else []

    def _harness_process(self) -> ManagedProcess:
        if self._process is None:
            self._process = self._launcher.start(self._plans["harness"], _PARTS)
            self._launcher.configure(self._process, protocol.ConfigureHarness(parts=_PARTS))
        return self._process
