"""The processes of a plan, and their nodes.

A node runs in the container that it names. The placement of other nodes is ``graph.placement``: in
their own processes (`separate`), in one common process (`shared`), or, for Python nodes, in the
process of the harness (`harness`). C++ components always need a component container; preprocessors
without a container always have their own processes.

With ``harness.placement: graph`` the player runs where the inputs are read, so that they need not
be sent to another process; each monitor runs where its topic is published. The spec names the
process (``in``) where that is not the only possible one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final, Literal

import msgspec

from r2bspec.diagnostics.diagnostic import Path
from r2bspec.language.spec import Container, Node, ProcessSettings, Spec, StartedProcess
from r2bspec.plan.command_lines import HARNESS_ARGV, NATIVE_ARGV, container_argv, node_argv
from r2bspec.plan.plan import ExternalPlan, JoinPlan, LifecyclePlan, NodePlan, ProcessPlan
from r2bspec.plan.wiring.wiring import NodeWiring, Phase, PhaseWiring, WiredEndpoint, Wiring

HARNESS_PROCESS_NAMES = ("loader", "player", "monitor")
"""Names of the processes of the harness."""

HARNESS_NAME = "harness"
"""Name of the process of a harness in a single process."""

CALLER_NAME: Final = "caller"
"""Name of the process that calls services while the player plays inputs."""

SHARED_PROCESS_NAME = "graph"
"""Name of the process of all Python nodes with ``placement: shared``."""

SHARED_CONTAINER_NAME = "components"
"""Name of the container of all C++ components with ``placement: shared``."""


def plan_processes(spec: Spec, wiring: Wiring) -> tuple[ProcessPlan, ...]:
    """Return all processes; those of each phase in the order publishers, nodes, subscriptions.

    The process of a preprocessor has the name ``preprocess.KEY``, which no node can have.
    """
    nodes = tuple(graph_processes(spec, wiring))
    if spec.harness.placement == "graph":
        return (*_preprocess(spec, wiring), *join_processes(spec, wiring, nodes))
    if has_single_harness(spec):
        return (*_preprocess(spec, wiring), _single_harness(spec, wiring), *nodes)
    before = () if spec.live else (_harness_process("player", "measure"),)
    if spec.playback.calls and not spec.plays_topics:
        before = (_harness_process("player", "measure", python=True),)
    elif spec.playback.calls:
        before = (*before, _harness_process(CALLER_NAME, "measure"))
    return (*_preprocess(spec, wiring), *before, *nodes, _harness_process("monitor", "measure"))


def plan_external(wiring: Wiring) -> tuple[ExternalPlan, ...]:
    """Return the nodes that must already run."""
    return tuple(
        ExternalPlan(name=node.name, phase=phase.phase)
        for phase in wiring.phases
        for node in phase.nodes
        if node.role is None
    )


def plan_lifecycle(wiring: Wiring) -> tuple[LifecyclePlan, ...]:
    """Return the nodes whose states the run changes, in the order of the spec."""
    return tuple(
        LifecyclePlan(name=node.name, phase=phase.phase, state=node.node.lifecycle)
        for phase in wiring.phases
        for node in phase.nodes
        if node.node.lifecycle is not None
    )


def has_single_harness(spec: Spec) -> bool:
    """Return True if the harness is a single process during the measurement."""
    return spec.harness.placement == "shared" or (
        spec.graph.placement == "harness" and spec.harness.placement != "graph"
    )


def reserved_names(spec: Spec) -> tuple[str, ...]:
    """Return the names of processes that no node of the graph, and no container, can have.

    ``graph`` and ``system`` are all processes of the graph, and the whole machine, in the names of
    metrics.
    """
    # In the graph: of the process in which the overhead is measured.
    single = has_single_harness(spec) or spec.harness.placement == "graph"
    harness = (HARNESS_NAME,) if single else ()
    shared = (SHARED_CONTAINER_NAME,) if spec.graph.placement == "shared" else ()
    caller = (CALLER_NAME,) if spec.playback.calls and spec.plays_topics else ()
    return (*HARNESS_PROCESS_NAMES, *harness, SHARED_PROCESS_NAME, *shared, *caller, "system")


def process_names(spec: Spec, wiring: Wiring) -> tuple[str, ...]:
    """Return the names of the processes that run during the measurement."""
    return tuple(each.name for each in plan_processes(spec, wiring) if each.phase == "measure")


def _preprocess(spec: Spec, wiring: Wiring) -> Iterator[ProcessPlan]:
    phase = wiring.preprocess
    if phase.nodes:
        yield _harness_process("loader", "preprocess")
    placed, alone = _group_by_container(phase.nodes, spec)
    yield from _containers(spec, wiring, placed, phase.phase)
    for node in alone:
        yield from _process(node, f"preprocess.{node.key}", phase.phase)


def graph_processes(spec: Spec, wiring: Wiring) -> Iterator[ProcessPlan]:
    """Yield the processes of the graph under test, without parts of the harness in them."""
    phase = wiring.measure
    placed, alone = _group_by_container(phase.nodes, spec)
    yield from _containers(spec, wiring, placed, phase.phase)
    together: list[NodeWiring] = []
    for node in alone:
        if spec.graph.placement == "separate" or not node.shares_process:
            yield from _process(node, node.key, phase.phase)
        else:
            together.append(node)
    if spec.graph.placement == "shared":
        yield from _shared(wiring, together)
    else:
        # The process of the harness can have Python nodes only.
        for node in together:
            if node.role == "container":
                yield from _process(node, node.key, phase.phase)


def _group_by_container(
    nodes: Iterable[NodeWiring], spec: Spec
) -> tuple[dict[str, list[NodeWiring]], list[NodeWiring]]:
    """Return the nodes by their containers, and the nodes without one."""
    placed: dict[str, list[NodeWiring]] = {}
    alone = []
    for node in nodes:
        if node.node.container in spec.containers:
            placed.setdefault(node.node.container, []).append(node)
        else:
            alone.append(node)
    return placed, alone


def _containers(
    spec: Spec, wiring: Wiring, placed: dict[str, list[NodeWiring]], phase: Phase
) -> Iterator[ProcessPlan]:
    """Yield the containers that are used, in the order of the spec."""
    for name, container in spec.containers.items():
        nodes = placed.get(name)
        if nodes:
            yield _container(name, container, nodes, wiring.namespace, phase)


def _container(
    name: str, container: Container, nodes: list[NodeWiring], namespace: str, phase: Phase
) -> ProcessPlan:
    python = container.executable == "python"
    argv = HARNESS_ARGV if python else container_argv(name, container, namespace)
    return _joint_process(
        name if phase == "measure" else f"preprocess.{name}",
        "host" if python else "container",
        (*container.prefix, *argv),
        nodes,
        phase=phase,
        env=container.env,
        container=name,
        **_process_settings(container),
    )


def _shared(wiring: Wiring, nodes: list[NodeWiring]) -> Iterator[ProcessPlan]:
    """Return one process for all Python nodes, and one for all C++ components."""
    argv = container_argv(SHARED_CONTAINER_NAME, Container(), wiring.namespace)
    components = [node for node in nodes if node.role == "container"]
    if components:
        yield _joint_process(SHARED_CONTAINER_NAME, "container", argv, components)
    python = [node for node in nodes if node.role == "host"]
    if python:
        yield _joint_process(SHARED_PROCESS_NAME, "host", HARNESS_ARGV, python)


def _joint_process(
    name: str,
    role: Literal["container", "host", "harness"],
    argv: tuple[str, ...],
    nodes: Iterable[NodeWiring],
    **rest: Any,
) -> ProcessPlan:
    """Return a process of several nodes; each of them adds to its environment."""
    rest = {"phase": "measure", "env": {}, **rest}
    for node in nodes:
        rest["env"] = rest["env"] | node.node.env
    return ProcessPlan(name=name, role=role, argv=argv, nodes=tuple(map(_node, nodes)), **rest)


def _harness_process(
    role: Literal["loader", "player", "monitor", "caller"], phase: Phase, *, python: bool = False
) -> ProcessPlan:
    argv = HARNESS_ARGV if python or role in {"loader", "caller"} else NATIVE_ARGV
    return ProcessPlan(name=role, role=role, phase=phase, argv=argv, env={})


def _single_harness(spec: Spec, wiring: Wiring) -> ProcessPlan:
    """Return the harness in one process, with the nodes of the graph that are placed in it."""
    python = [
        node
        for node in wiring.measure.nodes
        if spec.graph.placement == "harness"
        and node.node.container not in spec.containers
        and node.shares_process
        and node.role == "host"
    ]
    # Python nodes need an interpreter, whose process then hosts the native parts, too.
    argv = HARNESS_ARGV if python else NATIVE_ARGV
    return _joint_process(HARNESS_NAME, "harness", argv, python)


def _process(node: NodeWiring, name: str, phase: Phase) -> Iterator[ProcessPlan]:
    """Yield the process of a node with its own process; none for an external node."""
    spec: Node = node.node
    role = node.role
    if role is None:
        return
    yield ProcessPlan(
        name=name,
        role=role,
        phase=phase,
        argv=(*spec.prefix, *node_argv(node)),
        env=dict(spec.env),
        nodes=(_node(node),),
        **_process_settings(spec),
    )


def _process_settings(process: StartedProcess) -> dict[str, Any]:
    limit = process.memory_limit
    memory_limit_bytes = 0 if limit is None else limit.bytes
    return {**ProcessSettings.fields_of(process), "memory_limit_bytes": memory_limit_bytes}


def _node(node: NodeWiring) -> NodePlan:
    kind = node.node.kind
    return NodePlan(
        name=node.name,
        node=node.key,
        namespace=node.namespace,
        target=node.node.python,
        parameters=dict(node.node.parameters if kind.any_program else node.parameters),
        remappings=dict(node.node.remappings),
        package=node.node.package if node.role == "container" else "",
        plugin=node.node.plugin,
        parameter_files=node.node.parameter_files or msgspec.UNSET,
        intra_process=node.node.intra_process or msgspec.UNSET,
        extra_arguments=dict(node.node.extra_arguments) or msgspec.UNSET,
    )


class PartPlacement(msgspec.Struct, frozen=True):
    """The place of a part of the harness.

    Attributes:
        part: ``player``, or the name of a monitor.
        path: the place in the spec that can name its process.
        process: the name of its process; empty if that is not decided.
        program: as in `JoinPlan`.
        named: what the spec says.
        choices: the processes that it can run in; those of the nodes in question, if there are any.
        external: whether only external nodes read its inputs, or publish its topic.
    """

    part: str
    path: Path
    process: str = ""
    program: str = ""
    named: str = ""
    choices: tuple[str, ...] = ()
    external: bool = False


def find_places(
    spec: Spec, wiring: Wiring, processes: Iterable[ProcessPlan]
) -> tuple[PartPlacement, ...]:
    """Return the place of the player, unless the benchmark is live, and of each monitor.

    Args:
        spec: with ``placement: graph``.
        wiring: which node reads and publishes which topic.
        processes: the processes of the graph.
    """
    owners = {node.node: process.name for process in processes for node in process.nodes}
    phase = wiring.measure
    places = []
    if not spec.live:
        topics = [wiring.topic(name) for name in spec.playback.inputs]
        readers = _nodes_of(phase, (end for topic in topics for end in phase.subscriptions(topic)))
        nodes = readers or phase.possible_subscribers
        places.append(_place("player", ("harness",), spec.harness.process, owners, nodes))
    for name, monitor in spec.monitors.items():
        topic = wiring.topic(monitor.topic)
        nodes = _nodes_of(phase, phase.publishers(topic)) or phase.possible_publishers
        places.append(_place(name, ("monitors", name), monitor.process, owners, nodes))
    return tuple(places)


def _nodes_of(phase: PhaseWiring, endpoints: Iterable[WiredEndpoint]) -> list[NodeWiring]:
    names = {endpoint.owner for endpoint in endpoints if endpoint.is_node}
    return [node for node in phase.nodes if node.name in names]


def _place(
    part: str, path: Path, named: str, owners: dict[str, str], nodes: Sequence[NodeWiring]
) -> PartPlacement:
    """Return the place of a part, whose topics these nodes read or publish."""
    processes = tuple(dict.fromkeys(owners.values()))
    if named:
        name, _, program = named.partition("/")
        process = owners.get(name, name if name in processes else "")
        return PartPlacement(part, path, process, program, named=named, choices=processes)
    likely = tuple(dict.fromkeys(owners[node.key] for node in nodes if node.key in owners))
    if nodes and not likely:
        return PartPlacement(part, path, choices=processes, external=True)
    choices = likely or processes
    return PartPlacement(part, path, choices[0] if len(choices) == 1 else "", choices=choices)


def join_processes(
    spec: Spec, wiring: Wiring, processes: Sequence[ProcessPlan]
) -> tuple[ProcessPlan, ...]:
    """Return the processes of the graph, with the parts of the harness that each gets.

    A part whose place is not decided, which is an error of the spec, runs in none.
    """
    places = find_places(spec, wiring, processes)
    return tuple(
        _joined(process, [place for place in places if place.process == process.name])
        for process in processes
    )


def _joined(process: ProcessPlan, places: Sequence[PartPlacement]) -> ProcessPlan:
    if not places:
        return process
    programs = [place.program for place in places if place.program]
    join = JoinPlan(
        player=any(place.path == ("harness",) for place in places),
        monitors=tuple(place.part for place in places if place.path != ("harness",)),
        program=programs[0] if programs else "",
    )
    return msgspec.structs.replace(process, join=join)
