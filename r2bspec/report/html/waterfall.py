"""A waterfall of a path: where its messages were, part after part, in median and slowest cases."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

from r2bspec.diagnostics.quote import clip, printable
from r2bspec.judge.measure.anatomy_summary import PartSummary, PathSummary
from r2bspec.judge.measure.units import show
from r2bspec.judge.result import Result
from r2bspec.report import anatomy_table
from r2bspec.report.document import Chart
from r2bspec.report.html import chart

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MAX_PATHS: Final = 8
"""Charts of a page; the tables of the other reports have every path."""

_MAX_LABEL: Final = 34
_BAR_IN: Final = 0.21
_FRAME_IN: Final = 1.0

_COLOURS: Final = {"transport": "s2", "wait": "s1", "held": "s1", "callback": "s0"}


def waterfalls(result: Result) -> Iterator[Chart]:
    """Yield a chart of each path, starting with the path that most messages took."""
    found = [
        (anatomy, path) for anatomy in anatomy_table.anatomies_of(result) for path in anatomy.paths
    ]
    for number, (anatomy, path) in enumerate(found[:_MAX_PATHS]):
        more = len(found) - _MAX_PATHS
        note = f" {more} more paths are in the other reports." if more > 0 and not number else ""
        title = f"Anatomy: {anatomy_table.title(anatomy, path)}"
        yield _waterfall(f"anatomy-{number}", title, path, note)


def _waterfall(name: str, title: str, path: PathSummary, note: str) -> Chart:
    shown = [part for part in path.parts if anatomy_table.is_shown(part, path)]
    largest = sorted(shown, key=lambda part: part.share, reverse=True)[:3]
    listed = ", ".join(
        f"{part.owner} {part.name} {anatomy_table.share(part.share)}" for part in largest
    )
    description = (
        f"{anatomy_table.caption(path)}. Most of the latency, {show(path.p50, 's')} at its median, "
        f"was in {listed}. The slowest message took {show(path.slowest, 's')}."
    )

    def paint(sketch: chart.ChartBuilder) -> None:
        usual, slowest = sketch.figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
        labels = [printable(clip(f"{part.owner}  {part.name}", _MAX_LABEL)) for part in shown]
        _bars(usual, path.parts, shown, [part.p50 or 0.0 for part in path.parts])
        _whiskers(usual, path.parts, shown)
        _bars(slowest, path.parts, shown, [part.slowest or 0.0 for part in path.parts])
        usual.set_yticks(range(len(shown)), labels=labels)
        usual.invert_yaxis()
        usual.set_xlabel("median and p99, ms")
        slowest.set_xlabel(f"the slowest message ({show(path.slowest, 's')}), ms")
        for axes in (usual, slowest):
            axes.set_xlim(0, axes.get_xlim()[1] * (1.2 if axes is usual else 1.0))
            axes.grid(axis="y", visible=False)
            axes.tick_params(axis="y", length=0)
        sketch.note = (
            "Each bar begins where the medians of the parts before it end; a line ends at p99. "
            f"{anatomy_table.caption(path)}.{note}"
        )

    return chart.draw(name, title, description, _FRAME_IN + _BAR_IN * len(shown), paint)


def _bars(
    axes: Axes, parts: Sequence[PartSummary], shown: Sequence[PartSummary], lengths: list[float]
) -> None:
    """A bar for each part that is shown, from where those before it end."""
    begins = 0.0
    for part, length in zip(parts, lengths, strict=True):
        if part in shown:
            ink = chart.PALETTE[_COLOURS.get(part.name, "quiet")]
            axes.barh(shown.index(part), length * 1e3, left=begins * 1e3, color=ink, height=0.7)
        begins += length


def _whiskers(axes: Axes, parts: Sequence[PartSummary], shown: Sequence[PartSummary]) -> None:
    """A line from the end of each bar to the 99th percentile of the part."""
    begins = 0.0
    for part in parts:
        middle = part.p50 or 0.0
        if part in shown and part.p99 is not None:
            place, ends = shown.index(part), (begins + part.p99) * 1e3
            ink = chart.PALETTE["ink"]
            axes.hlines(place, (begins + middle) * 1e3, ends, color=ink, linewidth=0.8)
            axes.vlines(ends, place - 0.2, place + 0.2, color=ink, linewidth=0.8)
            text = f" {show(part.p50, 's')}, {show(part.p99, 's')}"
            chart.write(axes, text, (ends, place), (3, 0), ink, va="center", fontsize=7)
        begins += middle
