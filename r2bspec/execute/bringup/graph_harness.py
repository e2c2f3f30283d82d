"""The player and the monitors in the processes of the graph, with ``placement: graph``.

Each process waits in its initialisation of ROS until its parts are configured: as with a harness in
processes of its own, the publishers of the inputs are older than every node.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import msgspec

from r2bspec.execute.bringup.launcher import Launcher
from r2bspec.execute.processes.monitor_group import MonitorGroup
from r2bspec.execute.processes.supervisor import ManagedProcess
from r2bspec.ipc import protocol
from r2bspec.plan.command_lines import NATIVE_ARGV
from r2bspec.plan.plan import MonitorPlan, Plan, ProcessPlan
from r2bspec.plan.taps import tap_monitors


class GraphHarness:
    """The parts that have been loaded into processes of the graph.

    Args:
        launcher: of the processes.
        plan: of the run.
        configure_player: makes the player play the inputs.
        rows_dir: receives the rows of monitors.

    Attributes:
        player: None until its process has been joined, and in a live run.
    """

    def __init__(
        self,
        launcher: Launcher,
        plan: Plan,
        configure_player: Callable[[ManagedProcess], None],
        rows_dir: Path,
    ) -> None:
        self._launcher = launcher
        self._plans = {each.name: each for each in plan.monitors}
        self._taps = tap_monitors(plan.monitors)
        self._configure_player = configure_player
        self._rows_dir = rows_dir
        self._monitors: list[tuple[ManagedProcess, frozenset[str]]] = []
        self.player: ManagedProcess | None = None

    def configure(self, child: ManagedProcess, plan: ProcessPlan) -> None:
        """Configure the parts of one process; the taps run with the first monitor.

        Raises:
            RunError: a part does not respond, or exited.
        """
        if "player" in child.parts:
            self.player = child.parts["player"]
            self._configure_player(self.player)
        if "monitor" in child.parts and plan.join is not None:
            taps: Iterable[MonitorPlan] = () if self._monitors else self._taps
            monitor = child.parts["monitor"]
            wanted = (*(self._plans[name] for name in plan.join.monitors), *taps)
            rows_dir = str(self._folder_of(wanted))
            self._launcher.configure(
                monitor, protocol.ConfigureMonitor(monitors=wanted, rows_dir=rows_dir)
            )
            self._monitors.append((monitor, frozenset(each.name for each in wanted)))

    def _folder_of(self, monitors: Iterable[MonitorPlan]) -> Path:
        """Where a process writes: a further one in a folder of its own, with links to its rows."""
        if not self._monitors:
            return self._rows_dir
        folder = self._rows_dir / f"monitor-{len(self._monitors) + 1}"
        folder.mkdir()
        for each in monitors:
            rows = f"{each.name}.rows"
            (self._rows_dir / rows).symlink_to(folder / rows)
        return folder

    @property
    def monitor(self) -> ManagedProcess:
        """All monitors, commanded as one."""
        return self._monitors[0][0] if len(self._monitors) == 1 else MonitorGroup(self._monitors)


def overhead_processes(processes: Iterable[ProcessPlan]) -> tuple[ProcessPlan, ...]:
    """Processes of the harness alone, in which its overhead is measured before the graph starts.

    It is one if one process of the graph has all parts, else two: messages pass from player to
    monitor as they will pass to and from the nodes.
    """
    one = sum(each.join is not None for each in processes) == 1
    made = ProcessPlan(name="harness", role="harness", phase="measure", argv=NATIVE_ARGV, env={})
    if one:
        return (made,)
    return (
        msgspec.structs.replace(made, name="player", role="player"),
        msgspec.structs.replace(made, name="monitor", role="monitor"),
    )
