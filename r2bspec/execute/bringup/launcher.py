"""Bringing a phase's processes up in order, and knowing when they are ready.

Writers come first, then nodes, then readers: a node that copies its QoS from publishers present
at its start, or that subscribes only when someone listens, needs that order. Ready means that
every planned endpoint is matched; what is missing when time is up is named.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from r2bspec.execute.bringup.commands import wait_for_end
from r2bspec.execute.bringup.spec_mismatches import (
    differences_of,
    refuse_undeclared,
    unmatched_remappings,
)
from r2bspec.execute.diagnosis.find_break import Break
from r2bspec.execute.diagnosis.observe_graph import Observer, breaks_of, told
from r2bspec.execute.errors import GraphDiffersError, NotReadyError, RunError
from r2bspec.execute.host.machine import interpreter
from r2bspec.execute.processes.affinity import place
from r2bspec.execute.processes.environment import RunEnvironment
from r2bspec.execute.processes.executables import resolve_argv, resolve_words
from r2bspec.execute.processes.middleware_check import check_loaded_rmw
from r2bspec.execute.processes.shared_memory_check import refuse_too_little_room
from r2bspec.execute.processes.supervisor import Child, Children
from r2bspec.ipc import protocol
from r2bspec.plan.command_lines import container_node
from r2bspec.plan.plan import AfterReadyPlan, Plan, ProcessPlan
from r2bspec.record.run_folder import RunFolder
from r2bspec.record.run_record import Difference

NODE_ROLES = frozenset({"host", "container", "command"})
"""Roles of processes that hold nodes of the graph and nothing of the harness."""

_COMPOSER = "containers.load_node"
"""The process that loads components; no node and no container can be called so."""

_CONFIGURE_S = 60.0
_ASK_S = 10.0
_POLL_S = 0.02


class Launcher:
    """Starts the processes of a plan.

    Attributes:
        endpoints: what the Python nodes really turned out to have, as `protocol.Ready` tells it.
        differences: what they did not take of the plan. None of it has ended the run so far.
        hosts: the processes of Python nodes, with the full names of these.
        rmw: the middleware that processes of the harness have loaded; empty until one says so.
    """

    def __init__(
        self,
        children: Children,
        environment: RunEnvironment,
        folder: RunFolder,
        base_dir: Path,
    ) -> None:
        self._children = children
        self._environment = environment
        self._folder = folder
        self._base_dir = base_dir
        self.endpoints: list[tuple[str, str, str, str]] = []
        self.rmw = ""
        self.differences: list[Difference] = []
        self._made: set[str] = set()
        self._opaque = False
        self.hosts: dict[Child, frozenset[str]] = {}

    def see_to_room(self, plan: Plan, phase: str) -> None:
        """See that the processes of a phase find the shared memory that they will need.

        Raises:
            SharedMemoryError: there is too little.
        """
        environment = self._environment
        refuse_too_little_room(plan, phase, environment.middleware, environment.segment_bytes)

    def start(self, plan: ProcessPlan, parts: Iterable[str] = ()) -> Child:
        """Start one process; a harness process, and each of its `parts`, then waits for its role.

        Raises:
            NotInstalledError: its program is not there.
        """
        harness = plan.role in {"loader", "player", "monitor", "harness"}
        environment = self._environment
        child = self._children.start(
            plan.name,
            plan.role,
            resolve_argv(plan),
            environment.of_harness(plan.env) if harness else environment.of_node(plan.env),
            cwd=self._base_dir,
            log=self._folder.log_path(plan.name),
            parts=parts,
        )
        place(plan, child.pid)
        return child

    def start_nodes(
        self,
        plans: Iterable[ProcessPlan],
        timeout_s: float,
        beside: Iterable[tuple[Child, ProcessPlan]] = (),
    ) -> list[Child]:
        """Start processes that hold nodes; returns when every Python node has been made.

        By then all components are loaded, too; of other processes nothing is known.

        Args:
            plans: the processes.
            timeout_s: how long the making of nodes may take.
            beside: processes that run already and hold nodes, too.

        Returns:
            The processes that were started, in order.

        Raises:
            RunError: a node cannot be made, is not made in time, or dies.
            GraphDiffersError: a node does not declare a parameter that the spec gives it.
        """
        plans = list(plans)
        self._opaque |= any(plan.role != "host" for plan in plans)
        children = [self.start(plan) for plan in plans]
        hosts = [
            (child, plan)
            for child, plan in zip(children, plans, strict=True)
            if plan.role == "host"
        ]
        hosts += beside
        for child, plan in hosts:
            child.send(
                protocol.ConfigureHost(
                    nodes=plan.nodes,
                    base_dir=str(self._base_dir),
                    executor=plan.executor,
                    threads=plan.threads,
                )
            )
        self._compose([plan for plan in plans if plan.role == "container"], timeout_s)
        for child, plan in hosts:
            ready = self._children.answer(child, protocol.Ready, timeout_s)
            refuse_undeclared(ready)
            self.endpoints += ready.endpoints
            self.differences += unmatched_remappings(ready)
            self.hosts[child] = frozenset(node.name for node in plan.nodes)
            self._made |= self.hosts[child]
        return children

    def ends_of(self, host: Child) -> Iterator[tuple[str, str, str]]:
        """The endpoints of the nodes of a host: topic, type, ``publishes`` or ``subscribes``."""
        for node, topic, kind, does in self.endpoints:
            if node in self.hosts[host]:
                yield topic, kind, does

    def endpoints_in(self, plan: Plan, phase: str) -> list[tuple[str, str, str, str]]:
        """What the Python nodes of a phase have."""
        nodes = {node.name for each in plan.processes if each.phase == phase for node in each.nodes}
        return [each for each in self.endpoints if each[0] in nodes]

    def expect_others(self) -> None:
        """Take note that nodes take part which nobody starts, and nobody can look into."""
        self._opaque = True

    def is_final(self, found: Break) -> bool:
        """Whether a break is there to stay, so that to wait longer or to try again is in vain.

        What two ends show of themselves is. What an end lacks is, once the node has been made;
        of a process that nobody can look into, it may still come.
        """
        if found.kind in {"types", "qos"}:
            return True
        if found.owner.startswith("/"):
            return found.owner in self._made
        return not self._opaque

    def _compose(self, plans: Iterable[ProcessPlan], timeout_s: float) -> None:
        """Load the components of containers that have been started.

        Raises:
            RunError: a container dies, does not answer in time, or refuses a component.
        """
        containers = tuple(
            protocol.Composition(container=container_node(each.argv), nodes=each.nodes)
            for each in plans
        )
        if not containers:
            return
        child = self._start_caller(_COMPOSER)
        timeout_ns = round(timeout_s * 1e9)
        self.configure(
            child, protocol.ConfigureComponents(containers=containers, timeout_ns=timeout_ns)
        )
        self._children.answer(child, protocol.Composed, timeout_s + _ASK_S)
        self._children.end([child])
        self._made |= {node.name for each in containers for node in each.nodes}

    def _start_caller(self, name: str) -> Child:
        """A process of the harness that calls services, and then waits for its role."""
        return self._children.start(
            name,
            "caller",
            [interpreter(), "-P", "-m", "r2bspec.harness.child"],
            self._environment.of_harness(),
            cwd=self._base_dir,
            log=self._folder.log_path(name),
        )

    def do(self, step: AfterReadyPlan) -> None:
        """Do what the spec says once the graph stands, and wait until it is done.

        Raises:
            StepFailedError: a command failed or took too long.
            ProcessFailedError: a service is not there, or does not answer.
        """
        name = f"after_ready.{step.name}"
        timeout_s = step.timeout_ns / 1e9
        log = self._folder.log_path(name)
        if step.argv:
            argv, env = resolve_words(step.argv, name), self._environment.of_node({})
            child = self._children.start(name, "command", argv, env, cwd=self._base_dir, log=log)
            wait_for_end(child, self._children, timeout_s)
            return
        child = self._start_caller(name)
        self.configure(
            child,
            protocol.ConfigureCaller(
                service=step.service,
                type=step.service_type,
                request=step.request,
                timeout_ns=step.timeout_ns,
            ),
        )
        self._children.answer(child, protocol.Called, timeout_s + _ASK_S)
        self._children.end([child])

    def configure(self, child: Child, command: Any) -> protocol.Ready:
        """Give a harness process its role and wait until it has taken it.

        Raises:
            MiddlewareError: it has loaded one that cannot be configured for the transport.
        """
        ready = self._children.ask(child, command, protocol.Ready, _CONFIGURE_S)
        if ready.rmw:
            self.rmw = ready.rmw
            check_loaded_rmw(self._environment.transport.kind, ready.rmw)
        return ready


def wait_until_matched(
    children: Children,
    launcher: Launcher,
    askers: dict[Child, dict[str, int]],
    plan: Plan,
    phase: str,
) -> None:
    """Wait until the harness's own endpoints have found their partners.

    Args:
        children: all processes.
        launcher: knows what endpoints the nodes have.
        askers: for each harness process, the topics it has endpoints on, and how many endpoints
            of others each must be matched with.
        plan: for the time allowed, and for naming what is missing.
        phase: ``preprocess`` or ``measure``.

    Raises:
        GraphDiffersError: some have not, in the time that the plan allows, and never will.
        NotReadyError: some have not, for whatever reason.
    """
    deadline = time.monotonic() + plan.start_timeout_ns / 1e9
    while True:
        missing: dict[str, tuple[int, int]] = {}
        for child, wanted in askers.items():
            matched = children.ask(child, protocol.CountMatches(), protocol.Matched, _ASK_S)
            missing |= {
                topic: (matched.counts.get(topic, 0), count)
                for topic, count in wanted.items()
                if matched.counts.get(topic, 0) < count
            }
        if not missing:
            return
        if time.monotonic() > deadline:
            raise _not_ready(children, launcher, plan, phase, missing)
        children.pump(_POLL_S)


def _not_ready(
    children: Children,
    launcher: Launcher,
    plan: Plan,
    phase: str,
    missing: dict[str, tuple[int, int]],
) -> RunError:
    """Say where the ways break."""
    eyes = children.observer()
    facts = Observer(children, eyes, plan, phase, launcher.endpoints_in(plan, phase)).look()
    inputs = [topic for topic in missing if topic in facts.inputs]
    silent = [topic for topic in missing if topic not in facts.inputs]
    breaks = breaks_of(facts, silent, inputs)
    seconds = plan.start_timeout_ns / 1e9
    counted = ", ".join(
        f"{topic}: {have} of {want} endpoints matched" for topic, (have, want) in missing.items()
    )
    return explain(
        launcher,
        breaks,
        f"the {phase} graph was not ready after {seconds:g} s ({counted}): "
        f"{told(facts, silent or inputs, breaks)}",
        otherwise=NotReadyError,
        hint="Check remappings, message types and QoS of the nodes on these topics.",
    )


def explain(
    launcher: Launcher,
    breaks: Sequence[Break],
    said: str,
    *,
    otherwise: type[RunError],
    hint: str,
) -> RunError:
    """The error for a graph that does not do what it should.

    Args:
        launcher: knows the nodes.
        breaks: where the ways of messages end.
        said: everything that the user is to be told.
        otherwise: the error where the graph is not clearly another than the spec's, so that to
            try again might help.
        hint: for that error.
    """
    differences = differences_of(breaks, launcher.differences, launcher.is_final)
    if differences:
        return GraphDiffersError(differences, said, differences[0].help or hint)
    return otherwise(said, hint=hint)


def listeners(launcher: Launcher, topics: Iterable[str]) -> dict[str, int]:
    """How many readers each topic has among the Python nodes that have been started."""
    return {
        topic: sum(
            name == topic and does == "subscribes" for _, name, _, does in launcher.endpoints
        )
        for topic in topics
    }


def readers_wanted(plan: Plan, topic: str, phase: str) -> int:
    """How many readers a topic of the harness must find: those planned, and at least one."""
    planned = (each for each in plan.topics if each.name == topic and each.phase == phase)
    readers = {
        reader for each in planned for reader in each.readers if reader not in {"loader", "monitor"}
    }
    return max(1, len(readers))
