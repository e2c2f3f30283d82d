"""External nodes and readiness probes, for which a start waits besides its endpoints.

`benchmark.start_timeout` is the deadline of a start, from its first process to its first output.
Readiness probes, the conditions under `ready`, must be met before anything is played. They have
timeouts of their own.

A node that lacks an endpoint, or publishes nothing, may still load a model. It does not if its
process neither runs nor waits for a processor, and if its executor answers, so that its constructor
has returned and no callback runs. A start in which this is true of every node, and in which nothing
has changed for a third of its timeout, is not waited for any longer.
"""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Final

import psutil

from r2bspec.execute.errors import NotReadyError
from r2bspec.execute.processes.resources import RunQueueWaits, family
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.middleware.middleware import DISCOVERY_VARIABLES
from r2bspec.plan.command_lines import INCLUDED_LAUNCH, container_node_name, has_planned_name
from r2bspec.plan.plan import Plan, ProbePlan, ProcessPlan
from r2bspec.record.run_folder import RunFolder
from r2bspec.safe_io.line_pattern import LinePattern, PatternError, compile_line_pattern

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
        """Sample the processes, and return for how many seconds they have been idle."""
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
        """Return how long the processes have run, or waited for a processor, in seconds."""
        pids = [*self._pids()]
        total_s = 0.0
        for pid in pids:
            with contextlib.suppress(psutil.Error):
                used = psutil.Process(pid).cpu_times()
                total_s += used.user + used.system
        waited_s = self._waits.update(0, pids)
        return total_s if math.isnan(waited_s) else total_s + waited_s


def patience_s(timeout_s: float) -> float:
    """Return how long a start waits without progress: a third of its timeout, in seconds."""
    return max(_MIN_PATIENCE_S, timeout_s / 3)


class IdleNodes:
    """Observes the processes of the nodes of one phase.

    Args:
        plan: the plan of the run.
        phase: ``preprocess`` or ``measure``.
        supervisor: the supervisor of all processes.
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
            process.name: process for process in plan.processes_in(phase) if process.nodes
        }
        self._has_external = any(node.phase == phase for node in plan.external)
        self._supervisor = supervisor
        self._idle = IdleTime(self._pids, clock)

    def update(self) -> float:
        """Sample the processes, and return for how many seconds they have been idle."""
        return self._idle.update()

    def answer(self) -> bool:
        """Return True if the executor of every node answers; False if a node cannot be asked.

        Raises:
            RunError: the observer does not respond.
        """
        if self._has_external or any(map(starts_others, self._processes.values())):
            return False
        command = protocol.ListParameters(exclude=(), timeout_ns=_ANSWER_NS)
        found = self._supervisor.ask_observer(command, protocol.ParameterLists, _REPLY_TIMEOUT_S)
        return all_answer(self._processes.values(), found)

    def _pids(self) -> Iterator[int]:
        for child in self._supervisor:
            if child.name in self._processes:
                yield from family(child.pid)


def all_answer(processes: Iterable[ProcessPlan], found: protocol.ParameterLists) -> bool:
    """Return True if every planned node has answered.

    A program may name its nodes itself: for each such process, one more node has to answer than the
    plan names. Containers have a node of their own.

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
            if has_planned_name(process, node):
                named.add(node.name)
            else:
                unnamed += 1
    answered = found.parameters.keys()
    return named <= answered and len(answered - named) >= unnamed


def starts_others(process: ProcessPlan) -> bool:
    """Return True if a process starts others, which a launch file may do with a delay."""
    return INCLUDED_LAUNCH in process.argv or "launch" in process.argv[:2]


_POLL_S = 0.05

_CHUNK_BYTES = 1 << 20
"""Of a log, searched at once."""


class StartDeadline:
    """The deadline that all steps of a start share, from its construction on.

    Attributes:
        timeout_s: how long the whole start may take, in seconds.
    """

    def __init__(self, timeout_ns: int, clock: Callable[[], float] = time.monotonic) -> None:
        self.timeout_s = timeout_ns / 1e9
        self._clock = clock
        self._ends_at = clock() + self.timeout_s

    @property
    def left_s(self) -> float:
        """The seconds that are left; 0 after the deadline."""
        return max(0.0, self._ends_at - self._clock())

    @property
    def over(self) -> bool:
        """Whether the start has taken too long."""
        return self._clock() > self._ends_at

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Stop the clock for the block: readiness probes and commands have their own timeouts."""
        began = self._clock()
        try:
            yield
        finally:
            self._ends_at += self._clock() - began


def wait_for_external(plan: Plan, supervisor: ProcessSupervisor, deadline: StartDeadline) -> None:
    """Wait until discovery shows every external node of the graph.

    Raises:
        NotReadyError: a node is missing at the deadline.
    """
    expected = sorted(node.name for node in plan.external if node.phase == "measure")

    def lacking() -> list[str]:
        graph = supervisor.ask_observer(protocol.ListGraph(), protocol.GraphSnapshot)
        return [name for name in expected if name not in graph.nodes]

    if missing := _wait_until_empty(lacking, supervisor, deadline):
        raise NotReadyError(
            f"external: {', '.join(missing)} is not running, or not in this ROS domain",
            hint=f"Start it before the run, in the same ROS domain.{_unpassed_discovery(plan)}",
            code="R2B649",
            blamed=missing[0],
        )


def _unpassed_discovery(plan: Plan) -> str:
    """Return which variables an external node may use for its discovery, and the run does not."""
    names = [name for name in DISCOVERY_VARIABLES if os.environ.get(name)]
    unpassed = ", ".join(name for name in names if name not in plan.environment)
    if not unpassed:
        return ""
    return f" {unpassed} is not passed on to the run: if the node uses it, add it to 'environment'."


def _wait_until_empty(
    lacking: Callable[[], list[str]], supervisor: ProcessSupervisor, deadline: StartDeadline
) -> list[str]:
    """Wait until nothing is lacking; what still is at the deadline."""
    while (missing := lacking()) and not deadline.over:
        supervisor.pump()
    return missing


def wait_for_probe(
    plan: ProbePlan,
    supervisor: ProcessSupervisor,
    folder: RunFolder,
    base_dir: Path,
) -> None:
    """Wait until the condition of a probe is met.

    Args:
        plan: the condition and its timeout.
        supervisor: all processes; the wait ends if one of them exits.
        folder: contains the logs.
        base_dir: to which the path of a file is relative.

    Raises:
        NotReadyError: it was not met in time.
    """
    timeout_s = plan.timeout_ns / 1e9
    lack = f"{plan.kind} {plan.target} does not exist"
    if plan.kind == "log":
        lack = f"the log of {plan.target} has no line with {plan.pattern!r}"
        is_met = _log_condition(plan, folder, supervisor)
    elif plan.kind == "file":
        is_met = (base_dir / plan.target).exists
    else:
        is_met = partial(_is_in_graph, plan, supervisor)
    if not supervisor.pump_until(is_met, timeout_s):
        raise NotReadyError(
            f"ready.{plan.name}: {lack} after {timeout_s:g} s",
            hint=f"The logs are in {folder.path / 'logs'}",
            code="R2B646",
        )


def wait_for_services(
    supervisor: ProcessSupervisor, player: ManagedProcess, deadline: StartDeadline
) -> None:
    """Wait until all services and actions that the player calls are available.

    Raises:
        NotReadyError: one is not at the deadline.
    """

    def lacking() -> list[str]:
        counts = supervisor.request(player, protocol.CountMatches(), protocol.Matched).counts
        return [name for name, count in counts.items() if not count]

    if missing := _wait_until_empty(lacking, supervisor, deadline):
        raise NotReadyError(
            f"no node offers {', '.join(missing)} after {deadline.timeout_s:g} s",
            hint="A name without '/' at its beginning is in the namespace of the graph, as "
            "its nodes are. 'ros2 service list -t' and 'ros2 action list -t' show names and types "
            "while the graph runs. A node that offers it late needs a longer "
            "'benchmark.start_timeout'.",
        )


def _log_condition(
    plan: ProbePlan, folder: RunFolder, supervisor: ProcessSupervisor
) -> Callable[[], bool]:
    try:
        pattern = compile_line_pattern(plan.pattern)
    except PatternError as error:
        raise NotReadyError(
            f"ready.{plan.name}: {plan.pattern!r} is not a valid regular expression: {error}",
            code="R2B646",
        ) from None
    # What the process of an earlier start wrote says nothing about this one.
    begin = next((child.log_start for child in supervisor if child.name == plan.target), 0)
    return LogSearch(folder.log_path(plan.target), pattern, begin).finds


def _is_in_graph(plan: ProbePlan, supervisor: ProcessSupervisor) -> bool:
    if plan.kind == "service":
        graph = supervisor.ask_observer(protocol.ListGraph(), protocol.GraphSnapshot)
        return plan.target in graph.services
    command = protocol.Discover(topics=(plan.target,))
    answer = supervisor.ask_observer(command, protocol.Discovered)
    return bool(answer.writers[plan.target] and answer.readers[plan.target])


class LogSearch:
    """Searches a log for a line, reading only what was added since the last time.

    Args:
        log: the file.
        pattern: what a line must contain.
        begin: where the search begins, in bytes.
    """

    def __init__(self, log: Path, pattern: LinePattern, begin: int = 0) -> None:
        self._log = log
        self._pattern = pattern
        self._at = begin

    def finds(self) -> bool:
        """Return True if a new line matches, or what there is of the last line."""
        try:
            with self._log.open("rb") as stream:
                if stream.seek(0, os.SEEK_END) < self._at:  # the log was cut
                    self._at = 0
                stream.seek(self._at)
                added = stream.read(_CHUNK_BYTES)
        except OSError:
            return False
        # An unfinished line is read again, unless it fills the chunk.
        self._at += added.rfind(b"\n") + 1 or (len(added) if len(added) == _CHUNK_BYTES else 0)
        return any(map(self._pattern, added.decode(errors="replace").splitlines()))
