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

from r2bspec.diagnostics.quote import clip
from r2bspec.record.run_folder import Stacks
from r2bspec.report.html.chart import Chart
from r2bspec.report.html.templates import render_text

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
    context = {
        "name": name,
        "title": title,
        "description": description,
        "boxes": boxes,
        "rows": rows,
        "width": _WIDTH,
        "height": rows * _ROW,
        "row": _ROW,
        "font": _FONT,
        "character": _CHAR,
        "min_characters": _MIN_CHARS,
    }
    return Chart(name, title, description, render_text("flame_graph.svg.j2", context), note)


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

    @property
    def colour(self) -> str:
        """The name of its colour in the palette, the same in every drawing, as `tint`."""
        return _COLOURS[self._number % len(_COLOURS)]

    @property
    def tint(self) -> str:
        """The opacity of its colour."""
        return _TINTS[self._number // len(_COLOURS) % len(_TINTS)]

    @property
    def _number(self) -> int:
        return zlib.crc32(self.name.encode(errors="replace"))


def _boxes(root: _Call, total: int) -> Iterator[_Box]:
    """The functions below one that are wide enough to be seen, callers before called ones."""
    waiting = [(root, 0, 0)]
    while waiting:
        call, before, level = waiting.pop()
        yield _Box(call.name, call.samples, call.samples / total, before / total, level)
        for _, child in sorted(call.called.items()):
            if child.samples >= _MIN_SHARE * total:
                waiting.append((child, before, level + 1))
            before += child.samples


def _description(stacks: Stacks, total: int) -> str:
    last: Counter[str] = Counter()
    for stack, samples in stacks.items():
        last[stack[-1]] += samples
    listed = ", ".join(
        f"{clip(name, 60)} {samples / total:.0%}" for name, samples in last.most_common(_LISTED)
    )
    return f"{total:,} samples; most were in {listed}."
