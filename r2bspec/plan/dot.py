"""A plan in the DOT language of Graphviz."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.plan.figure import Box, figure
from r2bspec.plan.plan import Plan

_SHAPES = {
    "node": "shape=box",
    "opaque": 'shape=box, style="rounded,dashed"',
    "harness": 'shape=component, style=filled, fillcolor="#e8eef7"',
    "bag": 'shape=cylinder, style=filled, fillcolor="#f3ead7"',
    "topic": 'shape=ellipse, color="#999999", fontsize=10',
}


def to_dot(plan: Plan) -> str:
    """The digraph, with a newline at its end."""
    return "\n".join(_lines(plan)) + "\n"


def _lines(plan: Plan) -> Iterator[str]:
    drawing = figure(plan)
    yield f"digraph {_quoted(plan.name)} {{"
    yield f"  label={_quoted(drawing.title)}; labelloc=t; rankdir=LR;"
    yield '  node [fontname="sans-serif"];'
    for box in drawing.boxes:
        yield f"  {_box(box)}"
    for group in drawing.groups:
        yield f"  subgraph cluster_{group.id} {{"
        yield f"    label={_quoted(group.title)}; style=rounded;"
        for box in group.boxes:
            yield f"    {_box(box)}"
        yield "  }"
    for arrow in drawing.arrows:
        style = " [style=dashed]" if arrow.stored else ""
        yield f"  {arrow.tail} -> {arrow.head}{style};"
    yield "}"


def _box(box: Box) -> str:
    label = _quoted("\n".join(line for line in box.lines if line))
    return f"{box.id} [{_SHAPES[box.kind]}, label={label}];"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'
