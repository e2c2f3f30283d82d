"""The verdicts: one line of values for each requirement, and the reason where it is not met."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.measure.units import at_rate
from r2bspec.report.report_wording import (
    bounds_text,
    estimate_text,
    reasons,
    requirement_text,
    several_monitors,
)
from r2bspec.report.terminal.style import DIM_STYLE, heading, verdict_text

_INDENT = 2
_REASON_INDENT = 4
_MIN_TEXT_WIDTH = 16


@dataclass(frozen=True)
class _Line:
    """The cells of one requirement: its text, the estimate, and its bounds."""

    verdict: RequirementVerdict
    text: str
    estimate: str
    bounds: str
    reasons: tuple[str, ...]


def verdict_section(
    verdict: Verdict, width: int, pace: str = "", *, verbose: bool = False
) -> RenderableType | None:
    """Every requirement, by objective; None if there are none.

    Args:
        verdict: to show.
        width: of the terminal.
        pace: what set the rate of messages, where none was offered.
        verbose: with the reasons of requirements that are met, too.
    """
    if not verdict.requirements:
        return None
    lines = _lines(verdict, verbose=verbose)
    widths = _widths(lines, width)
    parts: list[RenderableType] = []
    for (name, at_hz), group in groupby(
        lines, key=lambda line: (line.verdict.objective, line.verdict.at_hz)
    ):
        if parts:
            parts.append("")
        parts.append(heading(name, at_rate(at_hz, pace) if at_hz or pace else ""))
        for line in group:
            parts += _requirement(line, widths)
    return Group(*parts)


def _lines(verdict: Verdict, *, verbose: bool) -> list[_Line]:
    several = several_monitors(verdict)
    return [
        _Line(
            verdict=one,
            text=requirement_text(one, name_monitor=several),
            estimate=estimate_text(one),
            bounds=bounds_text(one),
            reasons=tuple(texts) if verbose or one.outcome != "pass" else (),
        )
        for one, texts in zip(
            verdict.requirements, reasons(verdict.requirements, name_monitor=several), strict=True
        )
    ]


def _widths(lines: list[_Line], width: int) -> tuple[int, int, int, int]:
    """Column widths for all lines; without enough room, the requirements are wrapped."""
    outcome = max(verdict_text(line.verdict).cell_len for line in lines)
    estimate = max(len(line.estimate) for line in lines)
    bounds = max(len(line.bounds) for line in lines)
    room = width - _INDENT - outcome - estimate - bounds - 2 * 3
    text = min(max(len(line.text) for line in lines), max(room, _MIN_TEXT_WIDTH))
    return outcome, text, estimate, bounds


def _requirement(line: _Line, widths: tuple[int, int, int, int]) -> list[RenderableType]:
    cells = Table.grid(padding=(0, 2, 0, 0), pad_edge=False)
    for number, column in enumerate(widths):
        cells.add_column(width=column, overflow="fold", justify="left" if number < 2 else "right")
    word = verdict_text(line.verdict)
    cells.add_row(word, *map(Text, (line.text, line.estimate, line.bounds)))
    texts = [
        Text(text, style=DIM_STYLE if number else "") for number, text in enumerate(line.reasons)
    ]
    return [
        Padding(cells, (0, 0, 0, _INDENT)),
        *(Padding(text, (0, 0, 0, _REASON_INDENT), expand=False) for text in texts),
    ]
