"""The verdicts: one line of numbers and one sentence for each requirement."""

from __future__ import annotations

from itertools import groupby

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from r2bspec.measure.units import show
from r2bspec.report.terminal.style import QUIET, heading, outcome_text
from r2bspec.slo.model import RequirementVerdict, Verdict

_REASON_INDENT = 4


def verdict_section(verdict: Verdict, width: int) -> RenderableType | None:
    """Every requirement, by objective; None if there are none."""
    if not verdict.requirements:
        return None
    widths = _widths(verdict.requirements, width)
    parts: list[RenderableType] = []
    for (name, at_hz), group in groupby(
        verdict.requirements, key=lambda one: (one.objective, one.at_hz)
    ):
        if parts:
            parts.append("")
        at = f"at {show(at_hz, 'Hz')}" if at_hz is not None else ""
        parts.append(heading(name, at))
        for one in group:
            parts += _requirement(one, widths)
    return Group(*parts)


def _requirement(one: RequirementVerdict, widths: tuple[int, ...]) -> list[RenderableType]:
    line = Table.grid(padding=(0, 2, 0, 0), pad_edge=False)
    for number, column in enumerate(widths):
        line.add_column(width=column, overflow="fold", justify="left" if number < 2 else "right")
    line.add_row(outcome_text(one.outcome), Text(one.text), *map(Text, _numbers(one)))
    said = [Text(one.reason)]
    if one.settle:
        said.append(Text(one.settle, style=QUIET))
    return [
        Padding(line, (0, 0, 0, 2)),
        *(Padding(text, (0, 0, 0, _REASON_INDENT), expand=False) for text in said),
    ]


def _numbers(one: RequirementVerdict) -> tuple[str, str]:
    """The estimate, and what the confidence bounds or the observation say of it."""
    return estimate(one), bounds(one)


def estimate(one: RequirementVerdict) -> str:
    """The estimate as text; ``lost`` where it is a message that never arrived."""
    return "lost" if one.lost else show(one.estimate, one.unit)


def bounds(one: RequirementVerdict) -> str:
    """The interval of confidence as text, one-sided where only one side is bounded."""
    if one.lower is None and one.upper is None:
        return "observed" if one.method == "observation" else ""
    if one.lower is None:
        return f"≤ {show(one.upper, one.unit)}"
    if one.upper is None:
        return f"≥ {show(one.lower, one.unit)}"
    lower, upper = show(one.lower, one.unit), show(one.upper, one.unit)
    return lower if lower == upper else f"{lower} … {upper}"


def _widths(requirements: tuple[RequirementVerdict, ...], width: int) -> tuple[int, ...]:
    """Column widths that suit all requirements; the text of a requirement gives way first."""
    outcome = max(outcome_text(one.outcome).cell_len for one in requirements)
    numbers = [max(len(_numbers(one)[column]) for one in requirements) for column in range(2)]
    text = max(len(one.text) for one in requirements)
    room = width - outcome - sum(numbers) - 2 - 2 * 3
    return (outcome, min(text, max(room, 16)), *numbers)
