"""Whether the nodes of a graph have started and do nothing any more.

A node that lacks an endpoint, or publishes nothing, may still load a model. It does not if its
process neither runs nor waits for a processor, and if its executor answers, so that its constructor
has returned and no callback runs. A start in which this is true of every node, and in which nothing
has changed for a third of its timeout, is not waited for any longer.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Final

import psutil

from r2bspec.execute.host.kernel_counters import RunQueueWaits, family
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.plan.command_lines import INCLUDED_LAUNCH, container_node_name
from r2bspec.plan.plan import Plan, ProcessPlan

_BUSY_SHARE: Final = 0.1
"""Of one processor: a node whose timers or discovery threads only look around takes less."""

_MIN_WINDOW_S: Final = 0.5

_ANSWER_NS: Final = 1_500_000_000
_REPLY_TIMEOUT_S: Final = 20.0
_MIN_PATIENCE_S: Final = 5.0


class IdleTime:
    """Measures for how long some processes have neither run nor waited for a processor.

    Args:
        pids: says which processes these are now.
        clock: a monotonic clock in seconds.
    """

    def __init__(
        self, pids: Callable[[], Iterable[int]], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._pids = pids
        self._clock = clock
        self._waits = RunQueueWaits()
        self._busy_s = self._total_busy_s()
        self._idle_since = self._looked_at = clock()

    def update(self) -> float:
        """Look at the processes; returns for how many seconds they have been idle."""
        now = self._clock()
        passed_s = now - self._looked_at
        if passed_s < _MIN_WINDOW_S:
            return self._looked_at - self._idle_since
        before_s, self._busy_s = self._busy_s, self._total_busy_s()
        if abs(self._busy_s - before_s) > _BUSY_SHARE * passed_s:
            self._idle_since = now
        self._looked_at = now
        return now - self._idle_since

    def _total_busy_s(self) -> float:
        """How long the processes have run, or waited for a processor, in seconds."""
        pids = [*self._pids()]
        total_s = 0.0
        for pid in pids:
            with contextlib.suppress(psutil.Error):
                used = psutil.Process(pid).cpu_times()
                total_s += used.user + used.system
        waited_s = self._waits.update(0, pids)
        return total_s if math.isnan(waited_s) else total_s + waited_s


def patience_s(plan: Plan) -> float:
    """How long a start without any progress is waited for: a third of its timeout, in seconds."""
    return idle_patience_s(plan.start_timeout_ns / 1e9)


def idle_patience_s(timeout_s: float) -> float:
    """The same for a timeout in seconds."""
    return max(_MIN_PATIENCE_S, timeout_s / 3)


class IdleNodes:
    """Observes the processes of the nodes of one phase.

    Args:
        plan: of the run.
        phase: ``preprocess`` or ``measure``.
        supervisor: of all processes.
        clock: a monotonic clock in seconds.
    """

    def __init__(
        self,
        plan: Plan,
        phase: str,
        supervisor: ProcessSupervisor,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._processes = {
            each.name: each for each in plan.processes if each.phase == phase and each.nodes
        }
        self._has_external = any(each.phase == phase for each in plan.external)
        self._supervisor = supervisor
        self._idle = IdleTime(self._pids, clock)

    def update(self) -> float:
        """Look at the processes; returns for how many seconds they have been idle."""
        return self._idle.update()

    def answer(self, observer: ManagedProcess) -> bool:
        """Whether the executor of every node answers; never for nodes that cannot be asked.

        Args:
            observer: a monitor or a loader.

        Raises:
            RunError: the observer does not respond.
        """
        if self._has_external or any(starts_others(each) for each in self._processes.values()):
            return False
        found = self._supervisor.request(
            observer,
            protocol.ListParameters(exclude=(), timeout_ns=_ANSWER_NS),
            protocol.ParameterLists,
            _REPLY_TIMEOUT_S,
        )
        return all_answer(self._processes.values(), found)

    def _pids(self) -> Iterator[int]:
        for child in self._supervisor:
            if child.name in self._processes:
                yield from family(child.pid)


def all_answer(processes: Iterable[ProcessPlan], found: protocol.ParameterLists) -> bool:
    """Whether every planned node is among those that have answered.

    A program may name its nodes itself: for each such process, one more node has to answer than
    the plan names. Containers have a node of their own. A lifecycle node may wait for its
    configuration.

    Args:
        processes: with nodes.
        found: what has answered.
    """
    named: set[str] = set()
    unnamed = 0
    for process in processes:
        if process.role == "container":
            named.add(container_node_name(process.argv))
        for node in process.nodes:
            if process.role != "command" or f"__node:={node.node}" in process.argv:
                named.add(node.name)
            else:
                unnamed += 1
    answered = found.parameters.keys()
    return not found.lifecycle and named <= answered and len(answered - named) >= unnamed


def starts_others(process: ProcessPlan) -> bool:
    """Whether a process starts others, which a launch file may do with a delay."""
    return INCLUDED_LAUNCH in process.argv or "launch" in process.argv[:2]
