"""The drawing of a plan: its content, as a Mermaid flowchart, and in the DOT language of Graphviz.

GitHub and GitLab render Mermaid in Markdown. The HTML page draws the same figure.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from r2bspec.plan.plan import Plan

BoxKind = Literal["node", "opaque", "harness", "bag", "topic"]


@dataclass(frozen=True, slots=True)
class FigureBox:
    """A box in the drawing.

    Attributes:
        id: unique in the figure; letters, digits and ``_``.
        kind: a node without known topics is ``opaque``.
        lines: its label, the name first.
    """

    id: str
    kind: BoxKind
    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Arrow:
    """An arrow between boxes; `stored` if messages are buffered in between."""

    tail: str
    head: str
    stored: bool = False


@dataclass(frozen=True, slots=True)
class Group:
    """The boxes of a phase, which is its title, too."""

    id: str
    boxes: tuple[FigureBox, ...]


@dataclass(frozen=True, slots=True)
class Figure:
    """A drawing: groups of boxes, other boxes, and arrows."""

    title: str
    boxes: tuple[FigureBox, ...]
    groups: tuple[Group, ...]
    arrows: tuple[Arrow, ...]


@dataclass
class _FigureBuilder:
    """Builds a figure; ids are assigned in the order of drawing."""

    plan: Plan
    ids: dict[tuple[str, str, str], str] = field(default_factory=dict)
    arrows: list[Arrow] = field(default_factory=list)

    def id_of(self, phase: str, kind: str, name: str) -> str:
        return self.ids.setdefault((phase, kind, name), f"b{len(self.ids)}")


def figure(plan: Plan) -> Figure:
    """Return the figure of a plan: both phases, and the messages between them."""
    sketch = _FigureBuilder(plan)
    sources = tuple(dataset.source for dataset in plan.datasets) or (plan.dataset.source,)
    played = any(sources)
    bag = FigureBox(sketch.id_of("", "bag", ""), "bag", sources)
    phases = [phase for phase in ("preprocess", "measure") if plan.processes_in(phase)]
    groups = tuple(_group(sketch, phase) for phase in phases)
    if played:
        _join_phases(sketch, bag.id)
    boxes = (bag,) if played else ()
    return Figure(plan.title or plan.name, boxes, groups, tuple(sketch.arrows))


def _group(sketch: _FigureBuilder, phase: str) -> Group:
    plan = sketch.plan
    topics = [each for each in plan.topics if each.phase == phase]
    seen = {owner for each in topics for owner in (*each.writers, *each.readers)}
    boxes = _harness_boxes(sketch, phase, seen)
    nodes = [
        (node.name, node.target or node.plugin or _program(process.argv[0]))
        for process in plan.processes_in(phase)
        for node in process.nodes
    ]
    nodes += [(node.name, "already runs") for node in plan.external if node.phase == phase]
    for name, what in nodes:
        kind: BoxKind = "node" if name in seen else "opaque"
        boxes.append(FigureBox(sketch.id_of(phase, "owner", name), kind, (name, what)))
    for topic in topics:
        box = FigureBox(sketch.id_of(phase, "topic", topic.name), "topic", (topic.name, topic.type))
        boxes.append(box)
        for publisher in topic.writers:
            sketch.arrows.append(Arrow(sketch.id_of(phase, "owner", publisher), box.id))
        for subscriber in topic.readers:
            for owner in _subscriber_boxes(plan, subscriber, topic.name):
                sketch.arrows.append(Arrow(box.id, sketch.id_of(phase, "owner", owner)))
    return Group(phase, tuple(boxes))


def _harness_boxes(sketch: _FigureBuilder, phase: str, seen: set[str]) -> list[FigureBox]:
    """Return the boxes of the harness, one for each role and monitor."""
    plan = sketch.plan
    if phase == "preprocess":
        names = ["loader"] if "loader" in seen else []
        if any(not input_.bag_topic for input_ in plan.inputs):
            names.append("recorder")
    else:
        player = ["player"] if plan.inputs or "player" in seen else []
        names = [*player, *(f"monitor {monitor.name}" for monitor in plan.monitors)]
    return [FigureBox(sketch.id_of(phase, "owner", name), "harness", (name,)) for name in names]


def _program(called: str) -> str:
    """Return the program of a process in short: package and executable, or the name of the file."""
    if called.startswith("$(executable "):
        return called.removeprefix("$(executable ").removesuffix(")")
    return called.rpartition("/")[2]


def _subscriber_boxes(plan: Plan, subscriber: str, topic: str) -> list[str]:
    if subscriber == "loader":
        return ["recorder"]
    if subscriber == "monitor":
        return [f"monitor {monitor.name}" for monitor in plan.monitors if monitor.topic == topic]
    return [subscriber]


def _join_phases(sketch: _FigureBuilder, bag: str) -> None:
    player = sketch.id_of("measure", "owner", "player")
    if any(input_.bag_topic for input_ in sketch.plan.inputs):
        sketch.arrows.append(Arrow(bag, player, stored=True))
    if ("preprocess", "owner", "loader") in sketch.ids:
        sketch.arrows.append(Arrow(bag, sketch.id_of("preprocess", "owner", "loader")))
    if ("preprocess", "owner", "recorder") in sketch.ids:
        recorder = sketch.id_of("preprocess", "owner", "recorder")
        sketch.arrows.append(Arrow(recorder, player, stored=True))


_DOT_SHAPES = {
    "node": "shape=box",
    "opaque": 'shape=box, style="rounded,dashed"',
    "harness": 'shape=component, style=filled, fillcolor="#e8eef7"',
    "bag": 'shape=cylinder, style=filled, fillcolor="#f3ead7"',
    "topic": 'shape=ellipse, color="#999999", fontsize=10',
}


def to_dot(plan: Plan) -> str:
    """Return the digraph, with a newline at its end."""
    drawing = figure(plan)
    lines = [
        f"digraph {_dot_quoted(plan.name)} {{",
        f"  label={_dot_quoted(drawing.title)}; labelloc=t; rankdir=LR;",
        '  node [fontname="sans-serif"];',
        *(f"  {_dot_box(box)}" for box in drawing.boxes),
    ]
    for group in drawing.groups:
        lines += [
            f"  subgraph cluster_{group.id} {{",
            f"    label={_dot_quoted(group.id)}; style=rounded;",
            *(f"    {_dot_box(box)}" for box in group.boxes),
            "  }",
        ]
    for arrow in drawing.arrows:
        style = " [style=dashed]" if arrow.stored else ""
        lines.append(f"  {arrow.tail} -> {arrow.head}{style};")
    return "\n".join([*lines, "}"]) + "\n"


def _dot_box(box: FigureBox) -> str:
    label = _dot_quoted("\n".join(line for line in box.lines if line))
    return f"{box.id} [{_DOT_SHAPES[box.kind]}, label={label}];"


def _dot_quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'


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
    drawing = figure(plan)
    lines = ["flowchart LR", *(f"  {_mermaid_box(box)}" for box in drawing.boxes)]
    for group in drawing.groups:
        boxes = (f"    {_mermaid_box(box)}" for box in group.boxes)
        lines += [f'  subgraph {group.id}["{group.id}"]', *boxes, "  end"]
    for arrow in drawing.arrows:
        lines.append(f"  {arrow.tail} {'-.->' if arrow.stored else '-->'} {arrow.head}")
    return "\n".join([*lines, *(f"  {style}" for style in _MERMAID_STYLES)]) + "\n"


def _mermaid_box(box: FigureBox) -> str:
    left, right = _MERMAID_SHAPES[box.kind]
    label = "<br/>".join(_mermaid_escaped(line) for line in box.lines if line)
    style = "" if box.kind == "node" else f":::{box.kind}"
    return f"{box.id}{left}{label}{right}{style}"


def _mermaid_escaped(text: str) -> str:
    """Mermaid has no escape character; special characters of labels are entities."""
    entities = {"#": "#35;", '"': "#quot;", "<": "#lt;", ">": "#gt;", "&": "#amp;"}
    return "".join(entities.get(letter, letter) for letter in text)
