"""The report in the terminal: the verdict in a line, what it rests on, then the values.

A requirement has one line of values, and the reason where it is not met.
"""

from __future__ import annotations

import io
import shutil
import sys
from itertools import groupby
from pathlib import Path
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import to_json
from r2bspec.judge.measure.units import at_rate, show
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import Verdict
from r2bspec.record.run_record import SearchRecord
from r2bspec.report import report_wording as wording
from r2bspec.report.findings_text import wants_colour
from r2bspec.report.headline import headline, reason_after
from r2bspec.report.notes import Notes, notes
from r2bspec.report.output import console, echo, echo_document, printed_text
from r2bspec.report.result_table import RequirementRow, reasons, requirement_rows
from r2bspec.report.terminal_tables import (
    DIM_STYLE,
    OUTCOME_STYLES,
    anatomy_sections,
    harness_overhead_section,
    heading,
    hop_sections,
    load_section,
    monitor_sections,
    overall_text,
)

_MIN_WIDTH = 60
"""Tables do not shrink below this; narrower terminals wrap."""

_PIPED_WIDTH = 100
"""The width of the text where there is no terminal."""

_WIDEST = 1000
"""The limit for the width of tables where there is no terminal."""


def show_result(
    result: Result, output_format: str, folder: Path | None = None, *, verbose: bool = False
) -> None:
    """Write a result to standard output.

    Args:
        result: what to write.
        output_format: ``text`` for the report, ``json`` for the content of ``result.json``.
        folder: the run folder, to be printed at the end; None for none.
        verbose: with every reason and every note.
    """
    if output_format == "json":
        # As bytes: JSON is UTF-8, whatever the encoding of the terminal.
        echo_document(to_json(result), nl=False)
    elif sys.stdout.isatty():
        terminal = standard_output()
        _print_report(result, folder, terminal, terminal.width, verbose=verbose)
    else:
        width = max(shutil.get_terminal_size((_PIPED_WIDTH, 24)).columns, _PIPED_WIDTH)
        text = to_text(result, folder, width, whole_tables=True, verbose=verbose)
        echo(text, nl=False)


def standard_output() -> Console:
    """A console for standard output."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A terminal that cannot show ✔ gets a question mark, not a traceback.
        sys.stdout.reconfigure(errors="replace")
    colour = wants_colour(sys.stdout)
    return console(color_system="auto" if colour else None)


def _print_report(
    result: Result, folder: Path | None, console: Console, width: int, *, verbose: bool
) -> None:
    """Print a result; tables that are wider than the report have the width of the console."""
    width = max(width, _MIN_WIDTH)
    is_wider = console.width > width
    line = headline(result)
    # One line, however long, where no terminal would wrap it: it is what logs are searched for.
    console.print(first_line(line, result.verdict), soft_wrap=is_wider)
    sections = (
        second_line(line, result.verdict),
        header(result),
        verdict_section(result.verdict, width, wording.own_pace(result.metrics), verbose=verbose),
        notes_section(notes(result, verbose=verbose)),
        *monitor_sections(result, width),
        *hop_sections(result.metrics),
        *anatomy_sections(result, verbose=verbose),
        load_section(result.metrics, width),
        harness_overhead_section(result.harness_overhead),
        search_section(result.metrics.search),
    )
    for section in sections:
        if section is not None:
            shown = max(width, _table_width(section, console)) if is_wider else None
            console.print(section, width=shown)
            console.print()
    if folder is not None:
        # Unwrapped, so that it can be copied. The outcome once more: its line may be out of sight.
        last = Text.assemble(overall_text(result.verdict), "  ", (str(folder), DIM_STYLE))
        console.print(last, soft_wrap=True)


def _table_width(section: RenderableType, console: Console) -> int:
    """The width of the widest table of a section; 0 without tables."""
    parts = section.renderables if isinstance(section, Group) else [section]
    tables = [part for part in parts if isinstance(part, Table)]
    return max((console.measure(table).maximum for table in tables), default=0)


def to_text(
    result: Result,
    folder: Path | None = None,
    width: int = 100,
    *,
    whole_tables: bool = False,
    verbose: bool = False,
) -> str:
    """The report as plain text, without colours.

    Args:
        result: what to show.
        folder: the run folder, named in the last line.
        width: of the text, in columns.
        whole_tables: tables that are wider are not cut.
        verbose: with every reason and every note.
    """
    return printed_text(
        lambda page: _print_report(result, folder, page, width, verbose=verbose),
        _WIDEST if whole_tables else width,
    )


_PROBE_STYLES = {True: "green", False: "red", None: "yellow"}


def header(result: Result) -> RenderableType:
    """The benchmark, the machine, the data, and the version."""
    title = result.title or result.name
    where = [
        _fact(result.machine, "cpu"),
        f"{_fact(result.machine, 'cores')} cores" if "cores" in result.machine else "",
        wording.loaded_rmw(result),
        _fact(result.dataset, "source"),
        wording.code_text(result),
        wording.starts_text(result.starts),
        f"r2bspec {result.versions['r2bspec']}" if "r2bspec" in result.versions else "",
    ]
    lines = [Text(title, style="bold"), Text(" · ".join(filter(None, where)), style=DIM_STYLE)]
    if result.judged_by:
        lines.append(
            Text(f"judged by the objectives and the gate of {result.judged_by}", style=DIM_STYLE)
        )
    lines += [Text(line, style=DIM_STYLE) for line in wording.comparison(result)]
    return Group(*(line for line in lines if line.plain))


def _fact(facts: dict[str, Any], key: str) -> str:
    return str(facts.get(key) or "")


def search_section(search: SearchRecord | None) -> RenderableType | None:
    """The peak as a bracket, what limited it, and every probe in the order of probing."""
    if search is None or not search.probes:
        return None
    probes = Text("  ")
    for number, probe in enumerate(search.probes):
        probes.append(" " if number else "")
        probes.append(
            f"{probe.rate_hz:.4g}{wording.probe_mark(probe)}",
            style=_PROBE_STYLES[True if probe.keeps_up and probe.holds is None else probe.holds],
        )
    lines: list[RenderableType] = [heading("search", f"peak {wording.peak_text(search)}"), probes]
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
    word = overall_text(verdict)
    return Text.assemble(word, (line.removeprefix(word.plain), "bold"))


def second_line(line: str, verdict: Verdict) -> RenderableType | None:
    """The verdict in a sentence; None if the first line has said it."""
    reason = reason_after(line, verdict)
    return Text(reason) if reason else None


_INDENT = 2
_REASON_INDENT = 4
_MIN_TEXT_WIDTH = 16


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
    rows = requirement_rows(verdict)
    texts = {row.index: own for row, own in zip(rows, reasons(rows), strict=True)}
    widths = _widths(rows, width)
    parts: list[RenderableType] = []
    for (name, at_hz), group in groupby(
        rows, key=lambda row: (row.verdict.objective, row.verdict.at_hz)
    ):
        if parts:
            parts.append("")
        parts.append(heading(name, at_rate(at_hz, pace) if at_hz or pace else ""))
        for row in group:
            explained = verbose or row.verdict.outcome != "pass"
            parts += _requirement(row, texts[row.index] if explained else [], widths)
    return Group(*parts)


def _widths(rows: list[RequirementRow], width: int) -> tuple[int, int, int, int]:
    """Column widths for all rows; without enough room, the requirements are wrapped."""
    outcome = max(Text(row.word).cell_len for row in rows)
    estimate = max(len(row.estimate) for row in rows)
    bounds = max(len(row.bounds) for row in rows)
    room = width - _INDENT - outcome - estimate - bounds - 2 * 3
    text = min(max(len(row.text) for row in rows), max(room, _MIN_TEXT_WIDTH))
    return outcome, text, estimate, bounds


def _requirement(
    row: RequirementRow, texts: list[str], widths: tuple[int, int, int, int]
) -> list[RenderableType]:
    cells = Table.grid(padding=(0, 2, 0, 0), pad_edge=False)
    for number, column in enumerate(widths):
        cells.add_column(width=column, overflow="fold", justify="left" if number < 2 else "right")
    word = Text(row.word, style=OUTCOME_STYLES[row.verdict.outcome])
    cells.add_row(word, *map(Text, (row.text, row.estimate, row.bounds)))
    return [
        Padding(cells, (0, 0, 0, _INDENT)),
        *(
            Padding(
                Text(text, style=DIM_STYLE if number else ""),
                (0, 0, 0, _REASON_INDENT),
                expand=False,
            )
            for number, text in enumerate(texts)
        ),
    ]


def render(report_input: ReportInput) -> bytes:
    """The terminal report without colours, 100 columns wide; wider tables are not cut."""
    text = to_text(report_input.result, whole_tables=True, verbose=report_input.verbose)
    return text.encode()
