"""A plan as a Mermaid flowchart, which GitHub and GitLab render in Markdown."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.plan.figure import Box, figure
from r2bspec.plan.plan import Plan

_SHAPES = {
    "node": ('["', '"]'),
    "opaque": ('["', '"]'),
    "harness": ('[["', '"]]'),
    "bag": ('[("', '")]'),
    "topic": ('(["', '"])'),
}

_STYLES = (
    "classDef harness fill:#e8eef7,stroke:#4a6fa5,color:#1b2a41",
    "classDef bag fill:#f3ead7,stroke:#a5803a,color:#41331b",
    "classDef topic fill:#ffffff,stroke:#999999,color:#333333",
    "classDef opaque stroke-dasharray:5 4",
)


def to_mermaid(plan: Plan) -> str:
    """The flowchart, with a newline at its end."""
    return "\n".join(_lines(plan)) + "\n"


def _lines(plan: Plan) -> Iterator[str]:
    drawing = figure(plan)
    yield "flowchart LR"
    for box in drawing.boxes:
        yield f"  {_box(box)}"
    for group in drawing.groups:
        yield f'  subgraph {group.id}["{_escaped(group.title)}"]'
        for box in group.boxes:
            yield f"    {_box(box)}"
        yield "  end"
    for arrow in drawing.arrows:
        yield f"  {arrow.tail} {'-.->' if arrow.stored else '-->'} {arrow.head}"
    for style in _STYLES:
        yield f"  {style}"


def _box(box: Box) -> str:
    left, right = _SHAPES[box.kind]
    label = "<br/>".join(_escaped(line) for line in box.lines if line)
    style = "" if box.kind == "node" else f":::{box.kind}"
    return f"{box.id}{left}{label}{right}{style}"


def _escaped(text: str) -> str:
    """Mermaid has no escape character; special characters of labels are entities."""
    entities = {"#": "#35;", '"': "#quot;", "<": "#lt;", ">": "#gt;", "&": "#amp;"}
    return "".join(entities.get(letter, letter) for letter in text)
