"""A flame graph: where the samples of a profiler were, drawn from folded stacks.

Each box is a function, as wide as its share of the samples; what it calls is above it. The calls
that all samples have in common, from the entry of the program on, tell little: only the last few of
them are drawn.
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final
from xml.etree import ElementTree as ET

from r2bspec.diagnostics.quote import clip
from r2bspec.record.run_folder import Stacks
from r2bspec.report.html.canvas import Chart
from r2bspec.report.html.svg import PALETTE

_WIDTH: Final = 605.0
_ROW: Final = 13.0
_FONT: Final = 8.0
_CHAR: Final = 4.7
"""The width of a character; wider ones are cut by the box, as browsers draw fonts of their own."""

_MIN_CHARS: Final = 4
_MIN_SHARE: Final = 0.001
_MAX_ROWS: Final = 80
_COMMON_ROWS: Final = 4
_LISTED: Final = 3
_COLOURS: Final = tuple(f"s{number}" for number in range(6))
_TINTS: Final = ("0.22", "0.32", "0.42")


@dataclass
class _Call:
    """A function with the functions that led to it, and its samples."""

    name: str
    samples: int = 0
    called: dict[str, _Call] = field(default_factory=dict)


def flame_graph(name: str, title: str, stacks: Stacks) -> Chart | None:
    """The flame graph of a profile; None without samples.

    Args:
        name: unique in the page.
        title: the heading of the figure.
        stacks: the samples, by their stack.
    """
    root = _tree(stacks)
    if not root.samples:
        return None
    base = _without_common_calls(root)
    boxes = [box for box in _boxes(base, base.samples) if box.level < _MAX_ROWS]
    rows = 1 + max(box.level for box in boxes)
    description = _description(stacks, root.samples)
    note = f"{description} Boxes under {_MIN_SHARE:.1%} of the samples are not drawn."
    svg = _svg(name, title, description, rows)
    for box in boxes:
        svg.append(_drawn(box, (rows - 1 - box.level) * _ROW))
    return Chart(name, title, description, ET.tostring(svg, encoding="unicode"), note)


def _tree(stacks: Stacks) -> _Call:
    root = _Call("all")
    for stack, samples in stacks.items():
        call = root
        call.samples += samples
        for name in stack:
            call = call.called.setdefault(name, _Call(name))
            call.samples += samples
    return root


def _without_common_calls(root: _Call) -> _Call:
    """The first of the last few calls that every sample has in common."""
    common = [root]
    while len(common[-1].called) == 1:
        (only,) = common[-1].called.values()
        if only.samples < root.samples:
            break
        common.append(only)
    return common[-_COMMON_ROWS:][0]


@dataclass(frozen=True)
class _Box:
    name: str
    samples: int
    share: float
    left: float
    level: int


def _boxes(root: _Call, total: int) -> Iterator[_Box]:
    """The functions below one that are wide enough to be seen, callers before called ones."""
    waiting = [(root, 0, 0)]
    while waiting:
        call, before, level = waiting.pop()
        yield _Box(call.name, call.samples, call.samples / total, before / total, level)
        for _, each in sorted(call.called.items()):
            if each.samples >= _MIN_SHARE * total:
                waiting.append((each, before, level + 1))
            before += each.samples


def _description(stacks: Stacks, total: int) -> str:
    last: Counter[str] = Counter()
    for stack, samples in stacks.items():
        last[stack[-1]] += samples
    listed = ", ".join(
        f"{clip(name, 60)} {samples / total:.0%}" for name, samples in last.most_common(_LISTED)
    )
    return f"{total:,} samples; most were in {listed}."


def _svg(name: str, title: str, description: str, rows: int) -> ET.Element:
    height = rows * _ROW
    svg = ET.Element(
        "svg",
        {
            "id": name,
            "class": "chart",
            "role": "img",
            "aria-labelledby": f"{name}-title",
            "aria-describedby": f"{name}-desc",
            "viewBox": f"0 0 {_WIDTH:g} {height:g}",
            "width": f"{_WIDTH * 4 / 3:.0f}",
            "height": f"{height * 4 / 3:.0f}",
            "font-family": "system-ui, 'DejaVu Sans', sans-serif",
            "font-size": f"{_FONT:g}",
        },
    )
    ET.SubElement(svg, "title", {"id": f"{name}-title"}).text = title
    ET.SubElement(svg, "desc", {"id": f"{name}-desc"}).text = description
    return svg


def _drawn(box: _Box, top: float) -> ET.Element:
    left, width = box.left * _WIDTH, box.share * _WIDTH
    group = ET.Element("g")
    # Browsers show it where the pointer is.
    ET.SubElement(group, "title").text = f"{clip(box.name, 300)}: {box.share:.1%}"
    ET.SubElement(
        group,
        "rect",
        {
            "x": f"{left:.1f}",
            "y": f"{top:.1f}",
            "width": f"{max(0.3, width - 0.5):.1f}",
            "height": f"{_ROW - 0.7:.1f}",
            "rx": "1",
            **_fill(box.name),
        },
    )
    room = int((width - 4) / _CHAR)
    if room >= _MIN_CHARS:
        place = {"x": f"{left + 2:.1f}", "y": f"{top + _ROW - 4:.1f}"}
        ink = {"fill": PALETTE["ink"], "class": "f-ink"}
        ET.SubElement(group, "text", place | ink).text = clip(box.name, room)
    return group


def _fill(name: str) -> dict[str, str]:
    """The colour of a function, the same in every drawing."""
    number = zlib.crc32(name.encode(errors="replace"))
    colour = _COLOURS[number % len(_COLOURS)]
    tint = _TINTS[number // len(_COLOURS) % len(_TINTS)]
    return {"fill": PALETTE[colour], "fill-opacity": tint, "class": f"f-{colour}"}
