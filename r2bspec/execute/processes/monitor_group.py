"""Monitors in several processes of the graph, commanded as one."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any

from r2bspec.execute.processes.process import ManagedProcess
from r2bspec.ipc import protocol


class MonitorGroup(ManagedProcess):
    """Sends commands to all monitors, and joins their answers to one.

    What is tapped for a while only (`protocol.StartTap`) is tapped by the first of them.

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
