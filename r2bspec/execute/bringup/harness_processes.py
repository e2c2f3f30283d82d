"""The player and the monitors, and the processes in which they run.

A plan gives player and monitor a process each, or one for both (role `harness`), in which Python
nodes may also run. With ``placement: graph`` they are parts of processes of the graph: each of
these waits in its initialisation of ROS until its parts are configured, so that the publishers of
the inputs are older than every node, and monitors in several processes are commanded as one. The
rest of the controller addresses a part and does not know its process.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from r2bspec.execute.bringup.launcher import Launcher
from r2bspec.execute.processes.supervisor import ManagedProcess
from r2bspec.ipc import protocol
from r2bspec.plan.command_lines import NATIVE_ARGV
from r2bspec.plan.plan import MonitorPlan, Plan, ProcessPlan
from r2bspec.plan.taps import tap_monitors

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


class MonitorGroup(ManagedProcess):
    """Sends commands to all monitors, and joins their answers to one.

    What is watched for a while only (`protocol.StartTap`) is watched by the first of them.

    Args:
        members: the monitors, each with the names of its topics; they have been configured.
    """

    def __init__(self, members: Sequence[tuple[ManagedProcess, frozenset[str]]]) -> None:
        first = members[0][0]
        super().__init__(first.name, first.role, first.process, first.log, None)
        self._members = list(members)
        self._asked: list[ManagedProcess] = []
        self._matched: list[protocol.Matched] = []
        for each, _ in self._members:
            each.inbox = _Forwarding(self, each)

    def send(self, message: Any) -> None:
        """Send a command to those that it is for."""
        commands = {each: self._part_of(message, names) for each, names in self._members}
        if isinstance(message, protocol.StartTap | protocol.StopTap):
            commands = {self._members[0][0]: message}
        self._asked = [each for each, command in commands.items() if command is not None]
        self._matched.clear()
        for each in self._asked:
            each.send(commands[each])

    def _part_of(self, message: Any, names: frozenset[str]) -> Any:
        """What a command says to the monitor of some topics; None if nothing."""
        if not isinstance(message, protocol.Subscribe):
            return message
        own = tuple(each for each in message.monitors if each.name in names)
        return protocol.Subscribe(monitors=own) if own else None

    def collect(self, matched: protocol.Matched) -> None:
        """Take the answer of one of them; with the last, the answer is complete."""
        self._matched.append(matched)
        if len(self._matched) == len(self._asked):
            counts = {topic: count for one in self._matched for topic, count in one.counts.items()}
            self.inbox.append(protocol.Matched(counts=counts))


class _Forwarding(deque[Any]):
    """The inbox of a member: answers go to the group, errors stay."""

    def __init__(self, group: MonitorGroup, member: ManagedProcess) -> None:
        super().__init__(member.inbox)
        self._group = group

    def append(self, message: Any) -> None:
        if isinstance(message, protocol.Matched):
            self._group.collect(message)
        else:
            super().append(message)
