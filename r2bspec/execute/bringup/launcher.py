"""Starting the processes of a phase in order.

The publishers of the harness start first, then the nodes, then the subscriptions of the harness:
nodes that copy their QoS from existing publishers, or that subscribe only once they have a
subscriber, need this order. `r2bspec.execute.graph_matching` waits until all are ready.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec

from r2bspec.execute.bringup.node_faults import (
    NOT_LOADED,
    not_loaded,
    require_declared_parameters,
    unmatched_remappings,
)
from r2bspec.execute.bringup.readiness import StartDeadline
from r2bspec.execute.errors import ProcessDiedError, ProcessFailedError, StepFailedError
from r2bspec.execute.processes import prerequisites
from r2bspec.execute.processes.environment import RunEnvironment
from r2bspec.execute.processes.process import describe_exit, shorten_slice
from r2bspec.execute.processes.scheduling import apply_to_process
from r2bspec.execute.processes.supervisor import REPLY_TIMEOUT_S, ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.native.build import harness_library
from r2bspec.plan.command_lines import NATIVE_ARGV, container_node_name
from r2bspec.plan.plan import HARNESS_ROLES, AfterReadyPlan, NodePlan, Plan, ProcessPlan, SetupPlan
from r2bspec.record.run_folder import RunFolder
from r2bspec.record.run_record import Difference
from r2bspec.safe_io.private_files import PRIVATE_UMASK, user_umask

if TYPE_CHECKING:
    from r2bspec.execute.anatomy import AnatomyObservation
    from r2bspec.execute.bringup.harness_processes import GraphJoins

_IMPORTING_ROLES = frozenset({"host", "loader"})
"""Roles of processes of Python that import ROS before anything else."""

_COMPONENT_LOADER = "containers.load_node"
"""The process that loads components; no node and no container can have this name."""

_OBSERVER = "harness.observer"
"""The process that says what discovery shows; no node can have this name."""

_CONFIGURE_TIMEOUT_S = 60.0
_Row = TypeVar("_Row", bound=tuple[str, ...])


class Launcher:
    """Starts the processes of a plan.

    Args:
        network: the words before a command line that start it in the network of the run.

    Attributes:
        endpoints: the actual endpoints of the Python nodes, as in `protocol.Ready`.
        differences: between the nodes and the plan, none of which has failed the run so far.
        hosts: the processes of Python nodes, with the full names of the nodes that they spin.
        programs: the names of those that make and spin their nodes themselves.
        rmw: the middleware that processes of the harness have loaded; empty until one says so.
        joins: loads the harness into processes of the graph; None where it runs in its own.
        anatomy: observes all processes from inside; None where they are not.
    """

    def __init__(
        self,
        supervisor: ProcessSupervisor,
        environment: RunEnvironment,
        folder: RunFolder,
        base_dir: Path,
        network: Sequence[str] = (),
    ) -> None:
        self._network = network
        self._supervisor = supervisor
        self._environment = environment
        self._folder = folder
        self._base_dir = base_dir
        self.endpoints: list[tuple[str, str, str, str]] = []
        self.rmw = ""
        self.joins: GraphJoins | None = None
        self.anatomy: AnatomyObservation | None = None
        self.differences: list[Difference] = []
        self._created_nodes: set[str] = set()
        self._has_opaque_nodes = False
        self.hosts: dict[ManagedProcess, frozenset[str]] = {}
        self.programs: set[str] = set()
        self._lifecycle_hosts: list[ManagedProcess] = []
        self._early: dict[str, ManagedProcess] = {}
        self._ready_observers: set[ManagedProcess] = set()

    def check_shared_memory(self, plan: Plan, phase: str) -> None:
        """Check that there is enough shared memory for the processes of a phase.

        Raises:
            CertainRunError: there is too little (R2B664).
        """
        environment = self._environment
        prerequisites.require_free_shared_memory(
            plan, phase, environment.middleware, environment.segment_bytes
        )

    def start(self, plan: ProcessPlan, parts: Iterable[str] = ()) -> ManagedProcess:
        """Start a process, unless it was started early; it then continues.

        A harness process, and each of its `parts`, waits for its role.

        Raises:
            NotInstalledError: its program is not installed.
        """
        if plan.name in self._early:
            return self._early.pop(plan.name)
        harness = plan.role in HARNESS_ROLES
        environment = self._environment
        variables = environment.for_harness(plan.env) if harness else environment.for_node(plan.env)
        if prerequisites.hosts_library(plan):
            variables[protocol.NATIVE_LIBRARY_VARIABLE] = str(prerequisites.built(harness_library))
        parts = tuple(parts)
        if self.joins is not None and plan.join is not None:
            variables = self.joins.environment(plan.name, variables)
        if self.anatomy is not None:
            variables = self.anatomy.environment(plan, variables)
        child = self._supervisor.start(
            plan.name,
            plan.role,
            [*self._network, *prerequisites.resolve_argv(plan)],
            variables,
            cwd=self._base_dir,
            log=self._folder.log_path(plan.name),
            parts=parts,
            native=("", *parts) if plan.argv == NATIVE_ARGV else parts,
        )
        apply_to_process(plan, child.pid)
        if plan.argv == NATIVE_ARGV or plan.role == "caller":
            # The harness alone: the graph runs as it would without the harness.
            shorten_slice(child.pid)
        return child

    def start_observer(self, settings: protocol.ConfigureObserver) -> ManagedProcess:
        """Start the process that reports what discovery shows; `wait_for_observer` waits for it.

        If it also publishes something, it is waited for here, so that all nodes, which are started
        later, receive that from the beginning.

        Raises:
            RunError: it is not ready in time, or exits.
        """
        child = self._early.pop(_OBSERVER, None) or self._start_helper(_OBSERVER, "observer")
        if settings.latched or settings.clock:
            self.configure(child, settings)
            self._ready_observers.add(child)
        else:
            child.send(settings)
        return child

    def wait_for_observer(self, child: ManagedProcess) -> None:
        """Wait until the observer is ready.

        Raises:
            RunError: it is not ready in time, or exits.
        """
        if child not in self._ready_observers:
            self._answer(child)
            self._ready_observers.add(child)

    def start_early(
        self,
        plans: Iterable[ProcessPlan],
        packages: tuple[str, ...] = (),
        *,
        observer: bool = True,
    ) -> None:
        """Start the processes that import ROS, and let them do it; all others start in order.

        These are the observer, the loader and the processes of Python nodes. They initialise ROS
        and create nodes only when their turn comes, so the order of the start is kept: this only
        overlaps the imports of several processes with each other and with the work of the
        controller.

        Args:
            plans: the processes of a phase; those that have been started early are left out.
            packages: of the messages that they will need.
            observer: whether the observer is among them.
        """
        for plan in plans:
            if plan.role in _IMPORTING_ROLES and plan.name not in self._early:
                self._import_early(self.start(plan), packages)
        if observer and _OBSERVER not in self._early:
            self._import_early(self._start_helper(_OBSERVER, "observer"), ())

    def _import_early(self, child: ManagedProcess, packages: tuple[str, ...]) -> None:
        child.send(protocol.Prepare(packages=packages))
        self._early[child.name] = child

    def start_nodes(
        self,
        plans: Iterable[ProcessPlan],
        deadline: StartDeadline,
        running_hosts: Iterable[tuple[ManagedProcess, ProcessPlan]] = (),
        on_joined: Callable[[ManagedProcess, ProcessPlan], None] = lambda _, __: None,
    ) -> list[ManagedProcess]:
        """Start processes with nodes, and return when every Python node has been created.

        All components are then loaded, too. The state of other processes is unknown.

        Args:
            plans: the processes.
            deadline: of the start.
            running_hosts: processes with nodes that already run.
            on_joined: configures the parts of a process of the graph, whose nodes wait meanwhile.

        Returns:
            The processes that were started, in order.

        Raises:
            RunError: a node cannot be created, is not created in time, or exits.
            GraphDifferencesError: a node does not declare a parameter that the spec sets.
        """
        # The process of the player first: the inputs have publishers before any other node starts.
        plans = sorted(plans, key=lambda plan: plan.join is None or not plan.join.player)
        self._has_opaque_nodes |= any(plan.role != "host" for plan in plans)
        started: list[tuple[ManagedProcess, ProcessPlan]] = []
        for plan in plans:
            started.append((self.start(plan), plan))
            if plan.join is not None and plan.join.player:
                self._join(*started[-1], deadline, on_joined)
        for child, plan in started:
            if plan.join is not None and not plan.join.player:
                self._join(child, plan, deadline, on_joined)
        if self.joins is not None:
            self.joins.release()
        hosts = [(child, plan) for child, plan in started if plan.role == "host"]
        hosts += running_hosts
        for child, plan in hosts:
            if plan.join is None:
                self._configure_host(child, plan)
        self._load_components([plan for plan in plans if plan.role == "container"], deadline)
        for child, plan in hosts:
            ready = self._supervisor.answer(
                child, protocol.Ready, deadline.left_s, deadline.timeout_s
            )
            if ready.is_program:
                # Nothing is known of its nodes: they are looked at from outside.
                self.hosts[child] = frozenset()
                self.programs.add(plan.name)
                self._has_opaque_nodes = True
                continue
            self.hosts[child] = frozenset(node.name for node in plan.nodes)
            if ready.lifecycle:
                self._lifecycle_hosts.append(child)
            self._learn(child, ready, without=ready.lifecycle)
        return [child for child, _ in started]

    def describe_lifecycle_nodes(self) -> None:
        """Ask Python hosts for the endpoints of their lifecycle nodes, which exist once configured.

        Raises:
            RunError: a host does not answer.
            GraphDifferencesError: a node does not declare a parameter that the spec sets.
        """
        while self._lifecycle_hosts:
            child = self._lifecycle_hosts.pop()
            ready = self._supervisor.request(child, protocol.DescribeNodes(), protocol.Ready)
            self._learn(child, ready, without=self.hosts[child] - {*ready.lifecycle})

    def _learn(self, child: ManagedProcess, ready: protocol.Ready, without: Iterable[str]) -> None:
        """Take down what the nodes of a host have, but for some of them."""
        left_out = {*without}

        def kept(rows: Iterable[_Row]) -> tuple[_Row, ...]:
            return tuple(row for row in rows if row[0] not in left_out)

        ready = msgspec.structs.replace(
            ready,
            endpoints=kept(ready.endpoints),
            undeclared=kept(ready.undeclared),
            unmatched=kept(ready.unmatched),
        )
        require_declared_parameters(ready)
        self.endpoints += ready.endpoints
        self.differences += unmatched_remappings(ready)
        self._created_nodes |= self.hosts[child] - left_out

    def _configure_host(self, child: ManagedProcess, plan: ProcessPlan) -> None:
        child.send(
            protocol.ConfigureHost(
                nodes=plan.nodes,
                base_dir=str(self._base_dir),
                executor=plan.executor,
                threads=plan.threads,
            )
        )

    def _join(
        self,
        child: ManagedProcess,
        plan: ProcessPlan,
        deadline: StartDeadline,
        on_joined: Callable[[ManagedProcess, ProcessPlan], None],
    ) -> None:
        """Load the harness into a process, whose nodes wait until all have it."""
        if self.joins is None:
            return
        if plan.role == "host":
            # A host initialises ROS when it knows its nodes.
            self._configure_host(child, plan)
        self.joins.join(child, plan, deadline.left_s)
        on_joined(child, plan)

    @property
    def known_differences(self) -> set[tuple[str, str]]:
        """The reported differences, as pairs of a node and a parameter or name."""
        return {(difference.owner, difference.name) for difference in self.differences}

    def has_created(self, owner: str) -> bool:
        """Return True if a node, or every node if it is unknown, has all of its endpoints.

        A node that cannot be queried may still create endpoints.
        """
        if owner.startswith("/"):
            return owner in self._created_nodes
        return not self._has_opaque_nodes

    def _load_components(self, plans: Collection[ProcessPlan], deadline: StartDeadline) -> None:
        """Load the components of containers that have been started.

        Raises:
            RunError: a container exits, or does not respond in time.
            GraphDifferencesError: it rejects a component.
        """
        if not plans:
            return
        loader = self._start_helper(_COMPONENT_LOADER, "caller")
        self.configure(loader, protocol.ConfigureComponents())
        for plan in plans:
            for node in plan.nodes:
                self._load_component(loader, plan, node, deadline)
                self._created_nodes.add(node.name)
        self._supervisor.end([loader])

    def _load_component(
        self, loader: ManagedProcess, plan: ProcessPlan, node: NodePlan, deadline: StartDeadline
    ) -> None:
        timeout_s = deadline.left_s
        command = protocol.LoadComponent(
            container=container_node_name(plan.argv), node=node, timeout_ns=round(timeout_s * 1e9)
        )
        try:
            answer = self._supervisor.request(
                loader, command, protocol.Composed, timeout_s + REPLY_TIMEOUT_S
            )
        except ProcessDiedError as died:
            doing = f"while {node.name} ({node.plugin}) was loaded"
            raise died.while_doing(doing, node.name) from died
        except ProcessFailedError as failed:
            # Its constructor may hang: the container says in which one, and does not answer.
            if failed.code != NOT_LOADED:
                raise
            raise ProcessFailedError(
                f"{failed}{self._running(plan).last_output()}",
                hint=failed.hint,
                code=NOT_LOADED,
                blamed=node.name,
            ) from failed
        if not answer.loaded:
            container = self._running(plan)
            raise not_loaded(node, plan.name, answer.reason, container.last_output())

    def _running(self, plan: ProcessPlan) -> ManagedProcess:
        return next(each for each in self._supervisor if each.name == plan.name)

    def _start_helper(self, name: str, role: str) -> ManagedProcess:
        """Start a harness process that is not in the plan; it then waits for its role."""
        return self._supervisor.start(
            name,
            role,
            [*self._network, sys.executable, "-P", "-m", "r2bspec.harness.child"],
            self._environment.for_harness(),
            cwd=self._base_dir,
            log=self._folder.log_path(name),
        )

    def run_setup_step(self, step: SetupPlan, note: Callable[[str], None]) -> None:
        """Run a setup step, unless the file that it creates already exists.

        Raises:
            StepFailedError: it failed, exceeded its timeout, or did not create its file.
            NotInstalledError: its program is not installed.
        """
        created = self._base_dir / step.creates if step.creates else None
        if created is not None and created.exists():
            note(f"{step.name}: {step.creates} already exists")
            return
        note(f"{step.name}: {' '.join(step.argv)}")
        environment = self._environment.for_node(step.env)
        folder = self._base_dir / step.directory
        # What it makes is the user's, and stays.
        self._run_command(f"setup.{step.name}", step, environment, folder, user_umask())
        if created is not None and not created.exists():
            raise StepFailedError(
                f"setup step {step.name} succeeded, but {step.creates} does not exist",
                hint="Correct 'creates' of the step; paths are relative to the spec.",
            )

    def _run_command(
        self,
        name: str,
        step: SetupPlan | AfterReadyPlan,
        environment: dict[str, str],
        folder: Path,
        umask: int = PRIVATE_UMASK,
    ) -> None:
        """Run the command of a step, and wait until it exits with status 0."""
        argv = [*self._network, *prerequisites.resolve_command(step.argv, name)]
        log = self._folder.log_path(name)
        child = self._supervisor.start(
            name, "command", argv, environment, cwd=folder, log=log, umask=umask
        )
        child.exit_expected = True
        timeout_s = step.timeout_ns / 1e9
        if not self._supervisor.pump_until(lambda: not child.is_running, timeout_s):
            raise StepFailedError(
                f"{name} did not exit within {timeout_s:g} s",
                hint=f"Increase its timeout, or read its output in {log}",
            )
        self._supervisor.end([child])
        if child.process.returncode:
            raise StepFailedError(
                f"{name} {describe_exit(child.process.returncode)}{child.last_output()}",
                hint=f"Its complete output is in {log}.",
            )

    def run_step(self, step: AfterReadyPlan) -> None:
        """Run one `after_ready` step and wait until it is done.

        Raises:
            StepFailedError: a command failed or exceeded its timeout.
            ProcessFailedError: a service does not exist, or does not respond.
        """
        name = f"after_ready.{step.name}"
        if step.argv:
            self._run_command(name, step, self._environment.for_node({}), self._base_dir)
            return
        command = protocol.ConfigureCaller(
            service=step.service,
            service_type=step.service_type,
            request=step.request,
            timeout_ns=step.timeout_ns,
        )
        child = self._start_helper(name, "caller")
        self.configure(child, command)
        self._supervisor.answer(child, protocol.Called, step.timeout_ns / 1e9 + REPLY_TIMEOUT_S)
        self._supervisor.end([child])

    def configure(self, child: ManagedProcess, command: Any) -> protocol.Ready:
        """Send a harness process its configuration and wait until it is ready.

        Raises:
            MiddlewareError: it has loaded one that cannot be configured for the transport.
        """
        child.send(command)
        return self._answer(child)

    def configure_all(
        self, commands: Sequence[tuple[ManagedProcess, Any]]
    ) -> tuple[protocol.Ready, ...]:
        """As `configure`, for several processes at once."""
        for child, command in commands:
            child.send(command)
        return tuple(self._answer(child) for child, _ in commands)

    def _answer(self, child: ManagedProcess) -> protocol.Ready:
        ready = self._supervisor.answer(child, protocol.Ready, _CONFIGURE_TIMEOUT_S)
        if ready.rmw:
            self.rmw = ready.rmw
            kind = self._environment.transport.kind
            prerequisites.require_configurable(kind, ready.rmw, "this installation")
        return ready


def message_packages(plan: Plan) -> tuple[str, ...]:
    """Return the packages of all messages that a plan names."""
    types = (topic.type for topic in plan.topics)
    return tuple(sorted({type_.partition("/")[0] for type_ in types if type_}))
