"""Player and monitors, and the processes of the graph: who shares a process with whom."""

from __future__ import annotations

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, quoted_list, rule
from r2bspec.diagnostics.quote import quote
from r2bspec.plan.plan import ProcessPlan
from r2bspec.plan.process_plans import Place, find_places, graph_processes


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
    for place in find_places(spec, wiring, graph_processes(spec, wiring)):
        if not place.process:
            yield Finding(
                message=_place_message(place),
                path=(*place.path, "in") if place.named else place.path,
                help=_place_help(place),
            )


def _place_message(place: Place) -> str:
    what = "the player" if place.path == ("harness",) else f"monitor {quote(place.part)}"
    does = "read the inputs" if place.path == ("harness",) else "publish its topic"
    if place.named:
        return f"no process of the graph is, or has a node, named {quote(place.named)}"
    if place.external:
        return f"{what} cannot join a process of the graph: external nodes {does}"
    return f"it is not decided which process gets {what}: several may {does}"


def _place_help(place: Place) -> str:
    if place.external or not place.choices:
        return "let r2bspec start the nodes, or write 'harness: {placement: separate}'"
    where = "harness" if place.path == ("harness",) else f"monitors.{place.part}"
    return f"set '{where}.in' to one of the processes: {quoted_list(place.choices)}"


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
    if len(processes) != 1 or spec.has_external_nodes or not _shared_by_design(processes[0]):
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


def _shared_by_design(process: ProcessPlan) -> bool:
    """Whether it is a process for several nodes: one that a robot shares between nodes, too."""
    return process.role == "container" or len(process.nodes) > 1
