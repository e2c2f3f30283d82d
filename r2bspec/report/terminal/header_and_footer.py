"""The parts of the report around its tables: the verdict in a line, the run, notes, the search."""

from __future__ import annotations

from typing import Any

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from r2bspec.judge.result import Result
from r2bspec.judge.verdict import Verdict
from r2bspec.measure.units import show
from r2bspec.record.run_record import SearchRecord
from r2bspec.report.headline import reason_after
from r2bspec.report.notes import Notes
from r2bspec.report.report_wording import (
    code_text,
    comparison,
    loaded_rmw,
    peak_text,
    probe_mark,
    starts_text,
)
from r2bspec.report.terminal.style import DIM_STYLE, heading, outcome_text

_STYLES = {True: "green", False: "red", None: "yellow"}


def header(result: Result) -> RenderableType:
    """The benchmark, the machine, the data, and the version."""
    title = result.title or result.name
    where = [
        _known(result.machine, "cpu"),
        f"{_known(result.machine, 'cores')} cores" if "cores" in result.machine else "",
        loaded_rmw(result),
        _known(result.dataset, "source"),
        code_text(result),
        starts_text(result.starts),
        f"r2bspec {result.versions['r2bspec']}" if "r2bspec" in result.versions else "",
    ]
    lines = [Text(title, style="bold"), Text(" · ".join(filter(None, where)), style=DIM_STYLE)]
    if result.judged_by:
        lines.append(
            Text(f"judged by the objectives and the gate of {result.judged_by}", style=DIM_STYLE)
        )
    lines += [Text(each, style=DIM_STYLE) for each in comparison(result)]
    return Group(*(line for line in lines if line.plain))


def _known(facts: dict[str, Any], key: str) -> str:
    return str(facts.get(key) or "")


def search_section(search: SearchRecord | None) -> RenderableType | None:
    """The peak as a bracket, what limited it, and every probe in the order of probing."""
    if search is None or not search.probes:
        return None
    probes = Text("  ")
    for number, probe in enumerate(search.probes):
        probes.append(" " if number else "")
        probes.append(
            f"{probe.rate_hz:.4g}{probe_mark(probe)}",
            style=_STYLES[True if probe.keeps_up and probe.holds is None else probe.holds],
        )
    lines: list[RenderableType] = [heading("search", f"peak {peak_text(search)}"), probes]
    failed = [probe for probe in search.probes if probe.rate_hz == search.fails_hz]
    if failed and failed[-1].holds is False:
        last = failed[-1]
        reason = f"at {show(last.rate_hz, 'Hz')}: {last.reason}"
        lines.append(Padding(Text(reason, style=DIM_STYLE), (0, 0, 0, 2)))
    return Group(*lines)


def notes_section(notes: Notes) -> RenderableType | None:
    """The notes; None if there are none."""
    if not notes.shown:
        return heading("notes", notes.more) if notes.more else None
    lines = [Text(text) for text in notes.shown]
    if notes.more:
        lines.append(Text(notes.more, style=DIM_STYLE))
    return Group(heading("notes"), *(Padding(line, (0, 0, 0, 2), expand=False) for line in lines))


def first_line(line: str, verdict: Verdict) -> Text:
    """The first line of the report, with its outcome in colour."""
    word = outcome_text(verdict.outcome)
    return Text.assemble(word, (line.removeprefix(word.plain), "bold"))


def second_line(line: str, verdict: Verdict) -> RenderableType | None:
    """The verdict in a sentence; None if the first line has said it."""
    reason = reason_after(line, verdict)
    return Text(reason) if reason else None
