"""Nodes and their processes: names, containers, and who shares a process with whom.

It also checks interface files and what is known of the topics of nodes.
"""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, Pointer, rule
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import did_you_mean, quote, quoted_list, suggestion
from r2bspec.language.spec import Container, Node
from r2bspec.language.spec_graph import PROCESS_KEYS
from r2bspec.plan.process_plans import PartPlacement, find_places, graph_processes, reserved_names
from r2bspec.plan.wiring.wiring import PhaseWiring


@rule("R2B203")
def node_name_reserved(context: Context) -> Findings:
    """Find nodes and containers whose process name is reserved or already in use."""
    reserved, containers = reserved_names(context.spec), context.spec.containers
    named = [(node.key, node.path) for node in context.wiring.measure.nodes]
    for name, path in (*named, *((name, ("containers", name)) for name in containers)):
        if name in reserved or (name in containers and path[0] != "containers"):
            yield Finding(
                message=f"the name {quote(name)} is already that of another process",
                path=path,
                key=True,
                help=f"rename it; reserved names: {quoted_list(reserved)}",
            )


@rule("R2B215")
def node_name_duplicate(context: Context) -> Findings:
    """Find nodes of one phase with the same name."""
    for phase in context.wiring.phases:
        first: dict[str, tuple[str, Path]] = dict(_generated_nodes(phase))
        for node in phase.nodes:
            if node.node.kind.names_own_nodes or not node.is_ros_process:
                continue
            what, path = first.setdefault(node.name, ("another node", node.path))
            if path != node.path or what != "another node":
                yield Finding(
                    message=f"node name {quote(node.name)} is already used by {what}",
                    path=node.path,
                    key=True,
                    help="rename the node, or change its namespace",
                    related=(Pointer("first use of the name", path, key=True),),
                )


def _generated_nodes(phase: PhaseWiring) -> Iterator[tuple[str, tuple[str, Path]]]:
    """Yield the nodes that a plan adds to those of the spec: the containers."""
    for node in phase.nodes:
        if node.node.kind.role == "container" and not node.node.container:
            yield f"{node.name}_container", (f"the container of {node.key}", node.path)


@rule("R2B223")
def interface_file_unusable(context: Context) -> Findings:
    """Find interface files that cannot be used."""
    for _, node in context.nodes:
        name = quote(f"interfaces/{node.key}.yaml")
        problem = context.companion_files.interface_errors.get(node.key)
        if problem:
            yield Finding(
                message=f"{name} is ignored: {problem}",
                path=node.path,
                key=True,
                help="recreate it with 'r2bspec interfaces'; if it is that of a node of another "
                "spec, give one of the two another key",
            )


@rule("R2B234")
def command_without_ros_arguments(context: Context) -> Findings:
    """Find commands without ROS arguments, because the spec does not mark them as ROS."""
    for _, node in context.nodes:
        if not node.is_ros_process:
            yield Finding(
                message=f"{node.key} is run exactly as written, without ROS arguments: its nodes "
                f"keep their own names, and are not in the namespace {node.namespace}",
                path=(*node.path, "command"),
                help="if it is a ROS node, state its topics with 'subscribes:' and 'publishes:'",
            )


@rule("R2B217")
def container_unknown(context: Context) -> Findings:
    """Find references to containers that are not declared."""
    containers = context.spec.containers
    for _, node in context.nodes:
        name = node.node.container
        if name and name not in containers:
            close = did_you_mean(name, containers)
            yield Finding(
                message=f"unknown container {quote(name)}",
                path=(*node.path, "container"),
                help=suggestion(name, containers, "declared containers")
                or f"declare it: {quote(f'containers: {{{name}: {{}}}}')}",
                related=(
                    Pointer(f"{quote(close)} is declared here", ("containers", close), key=True),
                )
                if close
                else (),
                suppresses={"containers"},
            )


@rule("R2B219")
def container_kind_mismatch(context: Context) -> Findings:
    """Find nodes of a kind that their container cannot load."""
    for _, node in context.nodes:
        container = context.spec.containers.get(node.node.container)
        if container is None:
            continue
        is_python = container.executable == "python"
        if node.node.kind.role == ("host" if is_python else "container"):
            continue
        contents = "Python nodes" if is_python else "C++ components"
        yield Finding(
            message=f"{node.key} cannot run in {quote(node.node.container)}, which loads "
            f"{contents}",
            path=(*node.path, "container"),
            help="use another container, or none",
            related=(
                Pointer(
                    f"container executable: {container.executable}",
                    ("containers", node.node.container, "executable"),
                ),
            ),
        )


_NO_SETTINGS = Node()


@rule("R2B221")
def process_setting_without_effect(context: Context) -> Findings:
    """Find process settings of nodes that share a process because of their placement."""
    placement = context.spec.graph.placement
    for _, node in context.nodes:
        # The language refuses settings of a process for a node in a container.
        is_alone = node.path[0] != "graph" or placement == "separate" or not node.shares_process
        for name in () if is_alone else PROCESS_KEYS:
            if getattr(node.node, name) != getattr(_NO_SETTINGS, name):
                yield Finding(
                    message=f"{quote(name)} of {node.key} has no effect: with 'placement: "
                    f"{placement}' the node shares a process",
                    path=(*node.path, name),
                    key=True,
                    help="give the node its own container or process",
                )


@rule("R2B222")
def threads_without_effect(context: Context) -> Findings:
    """Find thread counts whose executor does not use them."""
    started: list[tuple[Path, Node | Container, str]] = [
        (node.path, node.node, "executor: multi_threaded")
        for _, node in context.nodes
        if node.start != "main" and node.node.executor == "single_threaded"
    ]
    started += [
        (
            ("containers", name),
            container,
            "executor: multi_threaded"
            if container.executable == "python"
            else "executable: component_container_mt",
        )
        for name, container in context.spec.containers.items()
        if container.executable != "component_container_mt"
        and not (container.executable == "python" and container.executor == "multi_threaded")
    ]
    for path, settings, needed in started:
        if settings.threads > 1:
            yield Finding(
                message=f"{quote(f'threads: {settings.threads}')} of {path[-1]} has no effect: its "
                "executor has one thread",
                path=(*path, "threads"),
                help=f"set {quote(needed)}",
            )


@rule("R2B672")
def harness_place_unknown(context: Context) -> Findings:
    """Find parts of the harness whose process in the graph is undecided."""
    spec, wiring = context.spec, context.wiring
    if spec.harness.placement != "graph":
        return
    if spec.graph.placement == "harness":
        yield Finding(
            message="the nodes are placed in the process of the harness, and the harness in the "
            "processes of the nodes",
            path=("graph", "placement"),
            help="remove one of 'graph.placement: harness' and 'harness.placement: graph'",
        )
        return
    first: dict[str, PartPlacement] = {}
    processes = tuple(graph_processes(spec, wiring))
    single = {process.name for process in processes if process.role != "command"}
    for place in find_places(spec, wiring, processes):
        path = (*place.path, "in") if place.named else place.path
        is_player = place.path == ("harness",)
        part = "the player" if is_player else f"monitor {quote(place.part)}"
        before = first.setdefault(place.process, place) if place.program else place
        is_sound = before.program == place.program and not (
            place.program and place.process in single
        )
        if place.process and is_sound:
            continue
        does = "read the inputs" if is_player else "publish its topic"
        message = f"it is not decided which process gets {part}: several may {does}"
        if place.process:
            message = (
                f"{quote(place.process)} has one program that gets parts, not {quote(place.named)}"
            )
        elif place.named:
            message = f"no process of the graph is, or has a node, named {quote(place.named)}"
        elif place.external:
            message = f"{part} cannot join a process of the graph: external nodes {does}"
        yield Finding(
            message=message,
            path=path,
            help="let r2bspec start the nodes, or write 'harness: {placement: separate}'"
            if place.external or not place.choices
            else f"set 'in' to one of the processes: {quoted_list(place.choices)}",
        )
