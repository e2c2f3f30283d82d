"""Bringing a phase's processes up in order, and knowing when they are ready.

Writers come first, then nodes, then readers: a node that copies its QoS from publishers present
at its start, or that subscribes only when someone listens, needs that order. Ready means that
every planned endpoint is matched; what is missing when time is up is named.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from r2bspec.execute.bringup.commands import wait_for_exit
from r2bspec.execute.bringup.spec_mismatches import (
    graph_mismatches,
    require_declared_parameters,
    unmatched_remappings,
)
from r2bspec.execute.bringup.start_deadline import StartDeadline
from r2bspec.execute.diagnosis.find_break import Fault
from r2bspec.execute.diagnosis.observe_graph import GraphObserver, fault_report, find_faults
from r2bspec.execute.errors import GraphMismatchError, NotReadyError, RunError
from r2bspec.execute.host.machine import interpreter
from r2bspec.execute.processes.affinity import apply_affinity
from r2bspec.execute.processes.environment import RunEnvironment
from r2bspec.execute.processes.executables import resolve_argv, resolve_command
from r2bspec.execute.processes.shared_memory_check import require_free_shared_memory
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.plan.command_lines import container_node_name
from r2bspec.plan.plan import AfterReadyPlan, Plan, ProcessPlan
from r2bspec.record.run_folder import RunFolder
from r2bspec.record.run_record import Difference

NODE_ROLES = frozenset({"host", "container", "command"})
"""Roles of processes that hold nodes of the graph and nothing of the harness."""

_COMPONENT_LOADER = "containers.load_node"
"""The process that loads components; no node and no container can be called so."""

_CONFIGURE_TIMEOUT_S = 60.0
_REPLY_TIMEOUT_S = 10.0
_POLL_S = 0.02


class Launcher:
    """Starts the processes of a plan.

    Attributes:
        endpoints: what the Python nodes really turned out to have, as `protocol.Ready` tells it.
        differences: what they did not take of the plan. None of it has ended the run so far.
        hosts: the processes of Python nodes, with the full names of these.
    """

    def __init__(
        self,
        supervisor: ProcessSupervisor,
        environment: RunEnvironment,
        folder: RunFolder,
        base_dir: Path,
    ) -> None:
        self._supervisor = supervisor
        self._environment = environment
        self._folder = folder
        self._base_dir = base_dir
        self.endpoints: list[tuple[str, str, str, str]] = []
        self.differences: list[Difference] = []
        self._created_nodes: set[str] = set()
        self._has_opaque_nodes = False
        self.hosts: dict[ManagedProcess, frozenset[str]] = {}

    def check_shared_memory(self, plan: Plan, phase: str) -> None:
        """See that the processes of a phase find the shared memory that they will need.

        Raises:
            SharedMemoryError: there is too little.
        """
        require_free_shared_memory(plan, phase, self._environment.segment_bytes)

    def start(self, plan: ProcessPlan, parts: Iterable[str] = ()) -> ManagedProcess:
        """Start one process; a harness process, and each of its `parts`, then waits for its role.

        Raises:
            NotInstalledError: its program is not there.
        """
        harness = plan.role in {"loader", "player", "monitor", "harness"}
        environment = self._environment
        child = self._supervisor.start(
            plan.name,
            plan.role,
            environment.secrets.in_words(resolve_argv(plan)),
            environment.for_harness(plan.env) if harness else environment.for_node(plan.env),
            cwd=self._base_dir,
            log=self._folder.log_path(plan.name),
            parts=parts,
        )
        apply_affinity(plan, child.pid)
        return child

    def start_nodes(
        self,
        plans: Iterable[ProcessPlan],
        deadline: StartDeadline,
        running_hosts: Iterable[tuple[ManagedProcess, ProcessPlan]] = (),
    ) -> list[ManagedProcess]:
        """Start processes that hold nodes; returns when every Python node has been made.

        By then all components are loaded, too; of other processes nothing is known.

        Args:
            plans: the processes.
            deadline: of the start.
            running_hosts: processes that run already and hold nodes, too.

        Returns:
            The processes that were started, in order.

        Raises:
            RunError: a node cannot be made, is not made in time, or dies.
            GraphMismatchError: a node does not declare a parameter that the spec gives it.
        """
        plans = list(plans)
        self._has_opaque_nodes |= any(plan.role != "host" for plan in plans)
        children = [self.start(plan) for plan in plans]
        hosts = [
            (child, plan)
            for child, plan in zip(children, plans, strict=True)
            if plan.role == "host"
        ]
        hosts += running_hosts
        for child, plan in hosts:
            child.send(
                protocol.ConfigureHost(
                    nodes=self._environment.secrets.in_nodes(plan.nodes),
                    base_dir=str(self._base_dir),
                    executor=plan.executor,
                    threads=plan.threads,
                )
            )
        self._load_components([plan for plan in plans if plan.role == "container"], deadline)
        for child, plan in hosts:
            ready = self._supervisor.answer(child, protocol.Ready, deadline.left_s)
            require_declared_parameters(ready)
            self.endpoints += ready.endpoints
            self.differences += unmatched_remappings(ready)
            self.hosts[child] = frozenset(node.name for node in plan.nodes)
            self._created_nodes |= self.hosts[child]
        return children

    def host_endpoints(self, host: ManagedProcess) -> Iterator[tuple[str, str, str]]:
        """The endpoints of the nodes of a host: topic, type, ``publishes`` or ``subscribes``."""
        for node, topic, kind, does in self.endpoints:
            if node in self.hosts[host]:
                yield topic, kind, does

    def endpoints_in(self, plan: Plan, phase: str) -> list[tuple[str, str, str, str]]:
        """What the Python nodes of a phase have."""
        nodes = {node.name for each in plan.processes if each.phase == phase for node in each.nodes}
        return [each for each in self.endpoints if each[0] in nodes]

    def mark_external_nodes(self) -> None:
        """Take note that nodes take part which nobody starts, and nobody can look into."""
        self._has_opaque_nodes = True

    def is_permanent(self, found: Fault) -> bool:
        """Whether a break is there to stay, so that to wait longer or to try again is in vain.

        What two ends show of themselves is. What an end lacks is, once the node has been made;
        of a process that nobody can look into, it may still come.
        """
        if found.kind in {"types", "qos"}:
            return True
        if found.owner.startswith("/"):
            return found.owner in self._created_nodes
        return not self._has_opaque_nodes

    def _load_components(self, plans: Iterable[ProcessPlan], deadline: StartDeadline) -> None:
        """Load the components of containers that have been started.

        Raises:
            RunError: a container dies, does not answer in time, or refuses a component.
        """
        containers = tuple(
            protocol.ContainerComponents(
                container=container_node_name(each.argv),
                nodes=self._environment.secrets.in_nodes(each.nodes),
            )
            for each in plans
        )
        if not containers:
            return
        child = self._start_service_client(_COMPONENT_LOADER)
        timeout_s = deadline.left_s
        timeout_ns = round(timeout_s * 1e9)
        self.configure(
            child, protocol.ConfigureComponents(containers=containers, timeout_ns=timeout_ns)
        )
        self._supervisor.answer(child, protocol.Composed, timeout_s + _REPLY_TIMEOUT_S)
        self._supervisor.end([child])
        self._created_nodes |= {node.name for each in containers for node in each.nodes}

    def _start_service_client(self, name: str) -> ManagedProcess:
        """A process of the harness that calls services, and then waits for its role."""
        return self._supervisor.start(
            name,
            "caller",
            [interpreter(), "-P", "-m", "r2bspec.harness.child"],
            self._environment.for_harness(),
            cwd=self._base_dir,
            log=self._folder.log_path(name),
        )

    def run_step(self, step: AfterReadyPlan) -> None:
        """Do what the spec says once the graph stands, and wait until it is done.

        Raises:
            StepFailedError: a command failed or took too long.
            ProcessFailedError: a service is not there, or does not answer.
        """
        name = f"after_ready.{step.name}"
        timeout_s = step.timeout_ns / 1e9
        log = self._folder.log_path(name)
        if step.argv:
            argv = self._environment.secrets.in_words(resolve_command(step.argv, name))
            env = self._environment.for_node({})
            child = self._supervisor.start(name, "command", argv, env, cwd=self._base_dir, log=log)
            wait_for_exit(child, self._supervisor, timeout_s)
            return
        child = self._start_service_client(name)
        self.configure(
            child,
            protocol.ConfigureCaller(
                service=step.service,
                type=step.service_type,
                request=self._environment.secrets.in_value(step.request),
                timeout_ns=step.timeout_ns,
            ),
        )
        self._supervisor.answer(child, protocol.Called, timeout_s + _REPLY_TIMEOUT_S)
        self._supervisor.end([child])

    def configure(self, child: ManagedProcess, command: Any) -> protocol.Ready:
        """Give a harness process its role and wait until it has taken it."""
        return self._supervisor.request(child, command, protocol.Ready, _CONFIGURE_TIMEOUT_S)


def wait_until_matched(
    supervisor: ProcessSupervisor,
    launcher: Launcher,
    expected_matches: dict[ManagedProcess, dict[str, int]],
    plan: Plan,
    phase: str,
    deadline: StartDeadline,
) -> None:
    """Wait until the harness's own endpoints have found their partners.

    Args:
        supervisor: all processes.
        launcher: knows what endpoints the nodes have.
        expected_matches: for each harness process, the topics it has endpoints on, and how many
            endpoints
            of others each must be matched with.
        plan: for naming what is missing.
        phase: ``preprocess`` or ``measure``.
        deadline: of the start.

    Raises:
        GraphMismatchError: some have not when the deadline is over, and never will.
        NotReadyError: some have not, for whatever reason.
    """
    while True:
        missing: dict[str, tuple[int, int]] = {}
        for child, wanted in expected_matches.items():
            matched = supervisor.request(
                child, protocol.CountMatches(), protocol.Matched, _REPLY_TIMEOUT_S
            )
            missing |= {
                topic: (matched.counts.get(topic, 0), count)
                for topic, count in wanted.items()
                if matched.counts.get(topic, 0) < count
            }
        if not missing:
            return
        if deadline.over:
            raise _not_ready_error(supervisor, launcher, plan, phase, missing)
        supervisor.pump(_POLL_S)


def _not_ready_error(
    supervisor: ProcessSupervisor,
    launcher: Launcher,
    plan: Plan,
    phase: str,
    missing: dict[str, tuple[int, int]],
) -> RunError:
    """Say where the ways break."""
    observer_process = supervisor.observer()
    facts = GraphObserver(
        supervisor, observer_process, plan, phase, launcher.endpoints_in(plan, phase)
    ).observe()
    inputs = [topic for topic in missing if topic in facts.inputs]
    silent = [topic for topic in missing if topic not in facts.inputs]
    faults = find_faults(facts, silent, inputs)
    seconds = plan.start_timeout_ns / 1e9
    counted = ", ".join(
        f"{topic}: {have} of {want} endpoints matched" for topic, (have, want) in missing.items()
    )
    return graph_error(
        launcher,
        faults,
        f"the {phase} graph was not ready after {seconds:g} s ({counted}): "
        f"{fault_report(facts, silent or inputs, faults)}",
        otherwise=NotReadyError,
        hint="Check remappings, message types and QoS of the nodes on these topics.",
    )


def graph_error(
    launcher: Launcher,
    faults: Sequence[Fault],
    said: str,
    *,
    otherwise: type[RunError],
    hint: str,
) -> RunError:
    """The error for a graph that does not do what it should.

    Args:
        launcher: knows the nodes.
        faults: where the ways of messages end.
        said: everything that the user is to be told.
        otherwise: the error where the graph is not clearly another than the spec's, so that to
            try again might help.
        hint: for that error.
    """
    differences = graph_mismatches(faults, launcher.differences, launcher.is_permanent)
    if differences:
        return GraphMismatchError(differences, said, differences[0].help or hint)
    return otherwise(said, hint=hint)


def subscription_counts(launcher: Launcher, topics: Iterable[str]) -> dict[str, int]:
    """How many readers each topic has among the Python nodes that have been started."""
    return {
        topic: sum(
            name == topic and does == "subscribes" for _, name, _, does in launcher.endpoints
        )
        for topic in topics
    }


def expected_subscriptions(plan: Plan, topic: str, phase: str) -> int:
    """How many readers a topic of the harness must find: those planned, and at least one."""
    planned = (each for each in plan.topics if each.name == topic and each.phase == phase)
    readers = {
        reader for each in planned for reader in each.readers if reader not in {"loader", "monitor"}
    }
    return max(1, len(readers))
