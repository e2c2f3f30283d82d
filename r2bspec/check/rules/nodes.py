"""Nodes and their processes: names, containers, and who shares a process with whom.

It also checks interface files and what is known of the topics of nodes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, Pointer, rule
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import did_you_mean, quote, quoted_list, suggestion
from r2bspec.language.node_kinds import PYTHON
from r2bspec.language.spec import Container, Node
from r2bspec.language.spec_graph import PROCESS_KEYS
from r2bspec.plan.process_plans import PartPlacement, find_places, graph_processes, reserved_names
from r2bspec.plan.wiring.wiring import NodeWiring, PhaseWiring


@rule("R2B203")
def node_name_reserved(context: Context) -> Findings:
    """Find nodes and containers whose process name is reserved or already in use."""
    reserved = reserved_names(context.spec)
    for node in context.wiring.measure.nodes:
        if node.key in reserved:
            yield _reserved_name("node", node.key, node.path, reserved)
        elif node.key in context.spec.containers:
            yield Finding(
                message=f"{quote(node.key)} is also the name of a container",
                path=node.path,
                key=True,
                help="rename one of them",
                related=(Pointer("the container", ("containers", node.key), key=True),),
            )
    for name in context.spec.containers:
        if name in reserved:
            yield _reserved_name("container", name, ("containers", name), reserved)


def _reserved_name(what: str, name: str, path: Path, reserved: Iterable[str]) -> Finding:
    return Finding(
        message=f"{what} name {quote(name)} is reserved",
        path=path,
        key=True,
        help=f"reserved names: {quoted_list(reserved)}",
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
    for _, node in context.nodes:
        for name in PROCESS_KEYS if _is_placed_with_others(context, node) else ():
            if getattr(node.node, name) != getattr(_NO_SETTINGS, name):
                yield Finding(
                    message=f"{quote(name)} of {node.key} has no effect: with 'placement: "
                    f"{context.spec.graph.placement}' the node shares a process",
                    path=(*node.path, name),
                    key=True,
                    help="give the node its own container or process",
                )


def _is_placed_with_others(context: Context, node: NodeWiring) -> bool:
    """Return whether a node shares a process by its placement.

    The language refuses settings of a process, and `env`, for a node in a container.
    """
    in_graph = node.path[0] == "graph" and context.spec.graph.placement != "separate"
    return in_graph and node.shares_process


@rule("R2B222")
def threads_without_effect(context: Context) -> Findings:
    """Find thread counts whose executor does not use them."""
    for _, node in context.nodes:
        is_program = node.node.kind is PYTHON and node.start.style == "main"
        if node.node.threads > 1 and node.node.executor == "single_threaded" and not is_program:
            yield Finding(
                message=f"{quote(f'threads: {node.node.threads}')} of {node.key} has no effect: "
                "its executor is single-threaded",
                path=(*node.path, "threads"),
                help="set 'executor: multi_threaded'",
            )
    for name, container in context.spec.containers.items():
        why = _why_unused_threads(container) if container.threads > 1 else ""
        if why:
            yield Finding(
                message=f"{quote(f'threads: {container.threads}')} of {quote(name)} has no effect: "
                f"{why}",
                path=("containers", name, "threads"),
                help="set 'executor: multi_threaded'"
                if container.executable == "python"
                else "set 'executable: component_container_mt'",
            )


def _why_unused_threads(container: Container) -> str:
    if container.executable == "component_container_mt":
        return ""
    if container.executable == "python":
        return "" if container.executor == "multi_threaded" else "its executor is single-threaded"
    return f"{container.executable} has no such setting"


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
        if not place.process:
            yield Finding(message=_place_message(place), path=path, help=_place_help(place))
        elif place.program and place.process in single:
            yield Finding(
                message=f"{quote(place.process)} is one program, and has no {quote(place.program)}",
                path=path,
                help=f"write {quote(place.process)}",
            )
        elif place.program:
            before = first.setdefault(place.process, place)
            if before.program != place.program:
                yield Finding(
                    message=f"{quote(place.named)} and {quote(before.named)} are two programs of "
                    f"{quote(place.process)}, of which only one can have parts of the harness",
                    path=path,
                    help=f"write {quote(before.named)} here, or start the nodes one by one",
                    related=(Pointer("the other program", (*before.path, "in")),),
                )


def _place_words(place: PartPlacement) -> tuple[str, str, str]:
    """Return the part of the harness, its key, and what the process does in which it belongs."""
    if place.path == ("harness",):
        return "the player", "harness.in", "read the inputs"
    return f"monitor {quote(place.part)}", f"monitors.{place.part}.in", "publish its topic"


def _place_message(place: PartPlacement) -> str:
    what, _, does = _place_words(place)
    if place.named:
        return f"no process of the graph is, or has a node, named {quote(place.named)}"
    if place.external:
        return f"{what} cannot join a process of the graph: external nodes {does}"
    return f"it is not decided which process gets {what}: several may {does}"


def _place_help(place: PartPlacement) -> str:
    if place.external or not place.choices:
        return "let r2bspec start the nodes, or write 'harness: {placement: separate}'"
    key = _place_words(place)[1]
    return f"set '{key}' to one of the processes: {quoted_list(place.choices)}"
