"""Nodes and their processes: names, containers, and who shares a process with whom.

What is known of the topics of nodes, and interface files, are here, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, Pointer, rule
from r2bspec.check.rules.machine import pays_for_images
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import did_you_mean, pluralize, quote, quoted_list, suggestion
from r2bspec.language.node_kinds import PYTHON
from r2bspec.language.spec import Container, Node, ProcessSettings
from r2bspec.language.spec_graph import PROCESS_KEYS
from r2bspec.plan import installed_packages
from r2bspec.plan.launch_programs import LaunchPrograms, launch_programs
from r2bspec.plan.process_plans import PartPlacement, find_places, graph_processes, reserved_names
from r2bspec.plan.wiring.python_files import source_folder
from r2bspec.plan.wiring.wiring import NodeWiring, PhaseWiring


@rule("R2B203")
def node_name_reserved(context: Context) -> Findings:
    """Nodes and containers whose process name is reserved or already in use."""
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
    """Nodes of one phase with the same name."""
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
    """The nodes that a plan adds to those of the spec: the containers."""
    for node in phase.nodes:
        if node.node.kind.role == "container" and not node.node.container:
            yield f"{node.name}_container", (f"the container of {node.key}", node.path)


@rule("R2B220")
def external_node_without_topics(context: Context) -> Findings:
    """External nodes without declared topics."""
    for _, node in context.nodes:
        interface = node.interface
        if (
            node.node.kind.role is None
            and interface.publishes is None
            and interface.subscribes is None
        ):
            yield Finding(
                message=f"the topics of external node {quote(node.name)} are unknown",
                path=node.path,
                key=True,
                help="list its topics under 'publishes:' or 'subscribes:'",
            )


@rule("R2B223")
def interface_file_unusable(context: Context) -> Findings:
    """Interface files that cannot be used."""
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
        versions = context.record_versions(node)
        if versions is not None:
            recorded, installed = versions
            yield Finding(
                message=f"{name} was recorded with version {recorded} of {node.node.package}, and "
                f"{installed} is installed",
                path=node.path,
                key=True,
                help="recreate it with 'r2bspec interfaces'; until then, what follows from it is "
                "not certain",
                machine_dependent=True,
            )


@rule("R2B234")
def command_without_ros_arguments(context: Context) -> Findings:
    """Commands that get no ROS arguments, because the spec says nothing of ROS about them."""
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
    """References to containers that are not declared."""
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


@rule("R2B218")
def container_unused(context: Context) -> Findings:
    """Containers without nodes."""
    used = {node.node.container for _, node in context.nodes}
    for name in context.spec.containers:
        if name not in used:
            yield Finding(
                message=f"container {quote(name)} has no nodes",
                path=("containers", name),
                key=True,
                help=f"set {quote(f'container: {name}')} for a node, or remove the container",
                suppressed_by={"containers"},
            )


@rule("R2B219")
def container_kind_mismatch(context: Context) -> Findings:
    """Nodes of a kind that their container cannot load."""
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
    """Process settings of nodes that share a process by their placement."""
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
    """Whether a node shares a process by its placement.

    The language refuses settings of a process, and `env`, for a node in a container.
    """
    in_graph = node.path[0] == "graph" and context.spec.graph.placement != "separate"
    return in_graph and node.shares_process


@rule("R2B222")
def threads_without_effect(context: Context) -> Findings:
    """Thread counts whose executor does not use them."""
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


@rule("R2B239")
def executor_of_program(context: Context) -> Findings:
    """Python nodes whose program makes another executor than the one that spins them here."""
    for _, node in context.nodes:
        if node.node.kind is not PYTHON:
            continue
        host: ProcessSettings = context.spec.containers.get(node.node.container, node.node)
        if node.start.style == "main":
            for key in ("executor", "threads"):
                if host is node.node and context.value_at((*node.path, key)) is not None:
                    yield Finding(
                        message=f"{quote(key)} of {node.key} has no effect: "
                        f"{node.node.python.rpartition(':')[2]} makes its executor itself",
                        path=(*node.path, key),
                        help=f"name the class instead, or leave out {quote(key)}",
                    )
            continue
        threads = node.start.threads_of_main
        if threads is None or host.executor == "multi_threaded":
            continue
        count = f" with {pluralize(threads, 'thread')}" if threads else ""
        more = f" and 'threads: {threads}'" if threads else ""
        where = "the node" if host is node.node else "its container"
        yield Finding(
            message=f"a program in the file of {node.key} spins it by a MultiThreadedExecutor"
            f"{count}; here it has a single-threaded one",
            path=(*node.path, "python"),
            help=f"write 'executor: multi_threaded'{more} for {where}, or name the program instead "
            "of the class",
        )


@rule("R2B615")
def environment_conflict(context: Context) -> Findings:
    """Nodes of one process that set an environment variable to different values."""
    first: dict[tuple[str, str], tuple[str, Path]] = {}
    for _, node in context.nodes:
        for name, value in node.node.env.items() if _is_placed_with_others(context, node) else ():
            path = (*node.path, "env", name)
            process = node.node.kind.name
            other_value, other_path = first.setdefault((process, name), (value, path))
            if other_value != value:
                yield Finding(
                    message=f"nodes of one process set different values of {name}",
                    path=path,
                    help="use the same value, or run the nodes in separate processes",
                    related=(Pointer("the other value", other_path),),
                )


@rule("R2B626")
def placement_in_harness(context: Context) -> Findings:
    """Nodes in the process of the harness."""
    graph = context.spec.graph
    if graph.placement != "harness":
        return
    colocated = [
        node.key
        for node in context.wiring.measure.nodes
        if node.role == "host" and node.shares_process and not node.node.container
    ]
    if colocated:
        yield Finding(
            message=f"{quoted_list(colocated)} share{'s' if len(colocated) == 1 else ''} one "
            "process, and the GIL of Python, with player and monitors",
            path=("graph", "placement"),
            help="use 'placement: separate' to run each node in its own process",
        )


@rule("R2B672")
def harness_place_unknown(context: Context) -> Findings:
    """Parts of the harness whose process in the graph is not decided."""
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
    places = find_places(spec, wiring, processes)
    chosen = {place.process for place in places if place.program}
    for place in places:
        if found := _launched_place(context, place, is_chosen=place.process in chosen):
            yield found
        elif not place.process:
            yield Finding(
                message=_place_message(place),
                path=(*place.path, "in") if place.named else place.path,
                help=_place_help(place),
            )
        elif place.program and place.process in single:
            yield Finding(
                message=f"{quote(place.process)} is one program, and has no {quote(place.program)}",
                path=(*place.path, "in"),
                help=f"write {quote(place.process)}",
            )
        elif place.program:
            before = first.setdefault(place.process, place)
            if before.program != place.program:
                yield Finding(
                    message=f"{quote(place.named)} and {quote(before.named)} are two programs of "
                    f"{quote(place.process)}, of which only one can have parts of the harness",
                    path=(*place.path, "in"),
                    help=f"write {quote(before.named)} here, or start the nodes one by one",
                    related=(Pointer("the other program", (*before.path, "in")),),
                )


def _launched_place(context: Context, place: PartPlacement, *, is_chosen: bool) -> Finding | None:
    """What is wrong with a part in a launch file whose programs are known."""
    known = _known_programs(context, place.process)
    if known is None:
        return None
    labels = tuple(dict.fromkeys(program.label for program in known.programs))
    path = (*place.path, "in") if place.named else place.path
    if place.program and not any(place.program in each for each in known.programs):
        return Finding(
            message=f"the launch file of {place.process} starts no {quote(place.program)}",
            path=path,
            part=(len(place.process) + 1, len(place.program)),
            help=suggestion(place.program, labels, "its programs") or "it starts no nodes",
        )
    if len(labels) > 1 and not known.has_conditions and not is_chosen:
        what, key, _ = _place_words(place)
        return Finding(
            message=f"the launch file of {place.process} starts {len(labels)} programs, and which "
            f"of them gets {what} is not said",
            path=path,
            help=f"set '{key}' to one of them: "
            f"{quoted_list(f'{place.process}/{each}' for each in labels)}",
        )
    return None


def _known_programs(context: Context, process: str) -> LaunchPrograms | None:
    """The programs of the launch file that a process is, if their names can be read."""
    nodes = context.wiring.measure.nodes
    launch = next((node.node.launch for node in nodes if node.key == process), None)
    if launch is None:
        return None
    base_dir = context.loaded.base_dir
    if launch.path:
        return launch_programs(base_dir / launch.path, source_folder(base_dir))
    share = installed_packages.package_share(launch.package)
    return None if share is None else launch_programs(share / launch.file, share)


def _place_words(place: PartPlacement) -> tuple[str, str, str]:
    """The part of the harness, its key, and what the process does in which it belongs."""
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


_TYPICAL = (
    "between two processes 0.04 ms for small messages and 1 ms for images of 1280x720, within one "
    "process 0.01 and 0.4 ms"
)


@rule("R2B673")
def harness_outside_process(context: Context) -> Findings:
    """A graph in one process, with player and monitors in others."""
    spec = context.spec
    if spec.harness.placement == "graph" or spec.graph.placement == "harness":
        return
    processes = tuple(graph_processes(spec, context.wiring))
    if len(processes) != 1 or spec.has_external_nodes:
        return
    # A process for several nodes: one that a robot shares between nodes, too.
    if processes[0].role != "container" and len(processes[0].nodes) < 2:
        return
    if pays_for_images(context, processes[0]):
        return
    container = processes[0].container
    yield Finding(
        message=f"the graph is in one process, {quote(processes[0].name)}, and player and monitors "
        "run in others: every latency contains the way there and back",
        path=("containers", container) if container else ("graph",),
        key=True,
        help="write 'harness: {placement: graph}' to play and monitor in that process; "
        "'r2bspec run --scan harness.placement=separate,graph' shows both. "
        f"Typical overheads (docs/performance.md): {_TYPICAL}",
    )
