"""The beginning and the end of the report: the run, the search, notes, and the verdict."""

from __future__ import annotations

from typing import Any

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from r2bspec.judge.result import Result
from r2bspec.judge.verdict import Verdict
from r2bspec.measure.units import show
from r2bspec.record.run_record import SearchRecord
from r2bspec.report.report_wording import (
    code_lines,
    comparison,
    loaded_rmw,
    notes,
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
        starts_text(result.starts),
        f"r2bspec {result.versions['r2bspec']}" if "r2bspec" in result.versions else "",
    ]
    lines = [Text(title, style="bold"), Text(" · ".join(filter(None, where)), style=DIM_STYLE)]
    if result.judged_by:
        lines.append(
            Text(f"judged by the objectives and the gate of {result.judged_by}", style=DIM_STYLE)
        )
    lines += [Text(each, style=DIM_STYLE) for each in code_lines(result)]
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


def notes_section(result: Result) -> RenderableType | None:
    """The notes; None if there are none."""
    texts = [*notes(result)]
    if not texts:
        return None
    return Group(
        heading("notes"), *(Padding(Text(note), (0, 0, 0, 2), expand=False) for note in texts)
    )


def overall(verdict: Verdict) -> RenderableType:
    """The verdict on the run, in one line."""
    return Text.assemble(outcome_text(verdict.outcome), "  ", verdict.reason)
