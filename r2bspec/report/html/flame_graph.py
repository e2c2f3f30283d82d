"""A flame graph: where the samples of a profiler were, drawn from folded stacks.

Each box is a function, as wide as its share of the samples; what it calls is above it. The calls
that all samples have in common, from the entry of the program on, tell little: only the last few of
them are drawn.
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
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


@dataclass(frozen=True, slots=True)
class _Call:
    """A function as others have called it.

    Attributes:
        depth: how many functions led to it, it included.
        stacks: those that lead through it, with their samples.
    """

    name: str
    depth: int
    samples: int
    stacks: list[tuple[tuple[str, ...], int]]

    def called(self) -> list[_Call]:
        """What it called, by name; found when asked for, because most is too narrow to be drawn."""
        groups: dict[str, list[tuple[tuple[str, ...], int]]] = {}
        for stack in self.stacks:
            if len(stack[0]) > self.depth:
                groups.setdefault(stack[0][self.depth], []).append(stack)
        return [
            _Call(name, self.depth + 1, sum(samples for _, samples in below), below)
            for name, below in sorted(groups.items())
        ]


def flame_graph(name: str, title: str, stacks: Stacks) -> Chart | None:
    """The flame graph of a profile; None without samples.

    Args:
        name: unique in the page.
        title: the heading of the figure.
        stacks: the samples, by their stack.
    """
    root = _Call("all", 0, sum(stacks.values()), list(stacks.items()))
    if not root.samples:
        return None
    base = _without_common_calls(root)
    boxes = list(_boxes(base, base.samples))
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


def _without_common_calls(root: _Call) -> _Call:
    """The first of the last few calls that every sample has in common."""
    common = [root]
    while len(called := common[-1].called()) == 1 and called[0].samples == root.samples:
        common.append(called[0])
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
        for child in call.called() if level + 1 < _MAX_ROWS else ():
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
