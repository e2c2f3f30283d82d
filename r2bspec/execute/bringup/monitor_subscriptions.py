"""The subscriptions of the monitor, created when their quality of service is known."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from r2bspec.execute.diagnosis.observe_graph import weakest_offer
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.plan.plan import MonitorPlan

_REPLY_TIMEOUT_S = 10.0


class MonitorSubscriptions:
    """Subscribes the monitor; a topic without a QoS waits until its publisher is discovered.

    Args:
        supervisor: all processes.
        observer: says what discovery shows.
        monitor: has been configured.
        monitors: the topics.
    """

    def __init__(
        self,
        supervisor: ProcessSupervisor,
        observer: ManagedProcess,
        monitor: ManagedProcess,
        monitors: Iterable[MonitorPlan],
    ) -> None:
        self._supervisor = supervisor
        self._observer = observer
        self._monitor = monitor
        self._waiting = tuple(monitors)

    def update(self) -> None:
        """Subscribe to what can be subscribed to now.

        Raises:
            RunError: a process does not respond, or exited.
        """
        if not self._waiting:
            return
        found = self._discover(tuple(each.topic for each in self._waiting if each.qos is None))
        ready = tuple(
            msgspec.structs.replace(each, qos=each.qos or weakest_offer(found.writers[each.topic]))
            for each in self._waiting
            if each.qos is not None or found.writers[each.topic]
        )
        names = {each.name for each in ready}
        self._waiting = tuple(each for each in self._waiting if each.name not in names)
        if ready:
            command = protocol.Subscribe(monitors=ready)
            self._supervisor.request(self._monitor, command, protocol.Matched, _REPLY_TIMEOUT_S)

    def _discover(self, topics: tuple[str, ...]) -> protocol.Discovered:
        if not topics:
            return protocol.Discovered(writers={}, readers={})
        command = protocol.Discover(topics=topics)
        return self._supervisor.request(
            self._observer, command, protocol.Discovered, _REPLY_TIMEOUT_S
        )
