"""The report in the terminal: the verdict in a line, what it rests on, then the values."""

from __future__ import annotations

import io
import shutil
import sys
from pathlib import Path

import msgspec
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from r2bspec.diagnostics.plain_text import escaped_json
from r2bspec.judge.judge_run import to_json
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import Verdict
from r2bspec.report.findings.print_findings import wants_colour
from r2bspec.report.headline import headline, verdict_headline
from r2bspec.report.notes import notes
from r2bspec.report.output import console, echo
from r2bspec.report.report_wording import own_pace
from r2bspec.report.terminal.cost_tables import harness_overhead_section, load_section
from r2bspec.report.terminal.header_and_footer import (
    first_line,
    header,
    notes_section,
    search_section,
    second_line,
)
from r2bspec.report.terminal.hop_table import hop_sections
from r2bspec.report.terminal.monitor_tables import monitor_sections
from r2bspec.report.terminal.style import DIM_STYLE, outcome_text
from r2bspec.report.terminal.verdict_lines import verdict_section

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
        sys.stdout.buffer.write(to_json(result))
        sys.stdout.flush()
    elif sys.stdout.isatty():
        print_report(result, folder, _standard_output(), verbose=verbose)
    else:
        _print_whole(result, folder, verbose=verbose)


def show_verdict(title: str, verdict: Verdict, output_format: str) -> None:
    """Write a verdict by itself to standard output.

    Args:
        title: of what was judged.
        verdict: what to write.
        output_format: ``text``, or ``json`` for the verdict as in ``result.json``.
    """
    if output_format == "json":
        content = msgspec.json.format(msgspec.json.encode(verdict), indent=2) + b"\n"
        sys.stdout.buffer.write(escaped_json(content))
        sys.stdout.flush()
        return
    terminal = _standard_output()
    line = verdict_headline(title, verdict)
    section = verdict_section(verdict, max(terminal.width, _MIN_WIDTH), verbose=True)
    for part in (first_line(line, verdict), second_line(line, verdict), section):
        if part is not None:
            terminal.print(part)


def _print_whole(result: Result, folder: Path | None, *, verbose: bool) -> None:
    """Write the report where no terminal limits its width: tables are not cut."""
    width = max(shutil.get_terminal_size((_PIPED_WIDTH, 24)).columns, _PIPED_WIDTH)
    text = to_text(result, folder, width, whole_tables=True, verbose=verbose)
    echo(text, nl=False)


def _standard_output() -> Console:
    """A console for standard output."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A terminal that cannot show ✔ gets a question mark, not a traceback.
        sys.stdout.reconfigure(errors="replace")
    colour = wants_colour(sys.stdout)
    return console(color_system="auto" if colour else None)


def print_report(
    result: Result,
    folder: Path | None,
    console: Console,
    *,
    whole_tables_from: int = 0,
    verbose: bool = False,
) -> None:
    """Print a result.

    Args:
        result: what to print.
        folder: the run folder, printed in the last line.
        console: to print to, with its width and colours.
        whole_tables_from: if it is not 0, the width of the report, which wider tables exceed up to
            the width of the console.
        verbose: with every reason and every note.
    """
    width = max(whole_tables_from or console.width, _MIN_WIDTH)
    line = headline(result)
    # One line, however long, where no terminal would wrap it: it is what logs are searched for.
    console.print(first_line(line, result.verdict), soft_wrap=bool(whole_tables_from))
    sections = (
        second_line(line, result.verdict),
        header(result),
        verdict_section(result.verdict, width, own_pace(result.metrics), verbose=verbose),
        notes_section(notes(result, verbose=verbose)),
        *monitor_sections(result, width),
        *hop_sections(result.metrics),
        load_section(result.metrics, width),
        harness_overhead_section(result.harness_overhead),
        search_section(result.metrics.search),
    )
    for section in sections:
        if section is not None:
            shown = max(width, _table_width(section, console)) if whole_tables_from else None
            console.print(section, width=shown)
            console.print()
    if folder is not None:
        # Unwrapped, so that it can be copied. The outcome once more: its line may be out of sight.
        last = Text.assemble(outcome_text(result.verdict.outcome), "  ", (str(folder), DIM_STYLE))
        console.print(last, soft_wrap=True)


def _table_width(section: RenderableType, console: Console) -> int:
    """The width of the widest table of a section; 0 without tables."""
    parts = section.renderables if isinstance(section, Group) else [section]
    tables = [part for part in parts if isinstance(part, Table)]
    return max((console.measure(each).maximum for each in tables), default=0)


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
    buffer = io.StringIO()
    columns = _WIDEST if whole_tables else width
    page = console(buffer, width=columns, color_system=None, legacy_windows=False)
    whole_from = width if whole_tables else 0
    print_report(result, folder, page, whole_tables_from=whole_from, verbose=verbose)
    return "".join(f"{line.rstrip()}\n" for line in buffer.getvalue().splitlines())
