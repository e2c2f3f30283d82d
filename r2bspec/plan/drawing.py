"""The drawing of a plan: a graph of boxes, and the same as a Mermaid flowchart.

GitHub and GitLab render Mermaid in Markdown. The HTML page draws the same graph.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal, NamedTuple

from r2bspec.plan.plan import Plan, TopicPlan

if TYPE_CHECKING:
    import networkx as nx

BoxKind = Literal["node", "opaque", "harness", "bag", "topic"]
PHASES = ("preprocess", "measure")


class Box(NamedTuple):
    """A box in the drawing.

    Attributes:
        phase: empty for the recording, which is before both.
        kind: a node without known topics is ``opaque``.
        lines: its label, the name first.
    """

    phase: str
    kind: BoxKind
    lines: tuple[str, ...]


def drawn_graph(plan: Plan) -> nx.DiGraph[Box]:
    """Return the boxes of a plan, and the messages between them.

    An edge has the attribute ``stored``: True if messages are buffered in between.
    """
    import networkx as nx

    graph: nx.DiGraph[Box] = nx.DiGraph()
    sources = tuple(dataset.source for dataset in plan.datasets) or (plan.dataset.source,)
    bag = Box("", "bag", sources)
    owners: dict[tuple[str, str], Box] = {("", ""): bag}
    if any(sources):
        graph.add_node(bag)
    for phase in PHASES:
        topics = [topic for topic in plan.topics if topic.phase == phase]
        for box in _owners(plan, phase, topics) if plan.processes_in(phase) else ():
            owners[phase, box.lines[0]] = box
            graph.add_node(box)
        for topic in topics:
            box = Box(phase, "topic", (topic.name, topic.type))
            graph.add_edges_from(
                ((owners[phase, writer], box) for writer in topic.writers), stored=False
            )
            readers = (name for reader in topic.readers for name in _readers(plan, reader, topic))
            graph.add_edges_from(((box, owners[phase, name]) for name in readers), stored=False)
    if any(sources):
        direct = any(input_.bag_topic for input_ in plan.inputs)
        joints = {
            (("", ""), ("measure", "player")): direct,
            (("", ""), ("preprocess", "loader")): True,
            (("preprocess", "recorder"), ("measure", "player")): True,
        }
        for (tail, head), is_there in joints.items():
            if is_there and tail in owners and head in owners:
                graph.add_edge(owners[tail], owners[head], stored=head[0] == "measure")
    return graph


def arrows_of(graph: nx.DiGraph[Box]) -> Iterator[tuple[Box, Box, bool]]:
    """Return the arrows of a drawing: tail, head, and whether messages are buffered in between."""
    arrows: Iterator[tuple[Box, Box, bool]] = iter(graph.edges(data="stored"))
    return arrows


def _owners(plan: Plan, phase: str, topics: list[TopicPlan]) -> Iterator[Box]:
    """Yield the parts of the harness, even if they share a process, and the nodes."""
    seen = {owner for topic in topics for owner in (*topic.writers, *topic.readers)}
    if phase == "preprocess":
        names = ["loader"] if "loader" in seen else []
        names += ["recorder"] if any(not input_.bag_topic for input_ in plan.inputs) else []
    else:
        names = ["player"] if plan.inputs or "player" in seen else []
        names += [f"monitor {monitor.name}" for monitor in plan.monitors]
    yield from (Box(phase, "harness", (name,)) for name in names)
    nodes = [
        (node.name, node.target or node.plugin or _program(process.argv[0]))
        for process in plan.processes_in(phase)
        for node in process.nodes
    ]
    nodes += [(node.name, "already runs") for node in plan.external if node.phase == phase]
    for name, what in nodes:
        yield Box(phase, "node" if name in seen else "opaque", (name, what))


def _program(called: str) -> str:
    """Return the program of a process in short: package and executable, or the name of the file."""
    if called.startswith("$(executable "):
        return called.removeprefix("$(executable ").removesuffix(")")
    return called.rpartition("/")[2]


def _readers(plan: Plan, reader: str, topic: TopicPlan) -> list[str]:
    if reader == "loader":
        return ["recorder"]
    if reader == "monitor":
        return [f"monitor {each.name}" for each in plan.monitors if each.topic == topic.name]
    return [reader]


_MERMAID_SHAPES = {
    "node": ('["', '"]'),
    "opaque": ('["', '"]'),
    "harness": ('[["', '"]]'),
    "bag": ('[("', '")]'),
    "topic": ('(["', '"])'),
}

_MERMAID_STYLES = (
    "classDef harness fill:#e8eef7,stroke:#4a6fa5,color:#1b2a41",
    "classDef bag fill:#f3ead7,stroke:#a5803a,color:#41331b",
    "classDef topic fill:#ffffff,stroke:#999999,color:#333333",
    "classDef opaque stroke-dasharray:5 4",
)


def to_mermaid(plan: Plan) -> str:
    """Return the flowchart, with a newline at its end."""
    graph = drawn_graph(plan)
    names = {box: f"b{number}" for number, box in enumerate(graph)}
    lines = ["flowchart LR"]
    for phase in ("", *PHASES):
        boxes = [f"{names[box]}{_label(box)}" for box in graph if box.phase == phase]
        if phase and boxes:
            lines += [f'  subgraph {phase}["{phase}"]', *(f"    {box}" for box in boxes), "  end"]
        else:
            lines += [f"  {box}" for box in boxes]
    for tail, head, stored in arrows_of(graph):
        lines.append(f"  {names[tail]} {'-.->' if stored else '-->'} {names[head]}")
    return "\n".join([*lines, *(f"  {style}" for style in _MERMAID_STYLES)]) + "\n"


def _label(box: Box) -> str:
    left, right = _MERMAID_SHAPES[box.kind]
    label = "<br/>".join(_escaped(line) for line in box.lines if line)
    style = "" if box.kind == "node" else f":::{box.kind}"
    return f"{left}{label}{right}{style}"


def _escaped(text: str) -> str:
    """Mermaid has no escape character; special characters of labels are entities."""
    entities = {"#": "#35;", '"': "#quot;", "<": "#lt;", ">": "#gt;", "&": "#amp;"}
    return "".join(entities.get(letter, letter) for letter in text)
