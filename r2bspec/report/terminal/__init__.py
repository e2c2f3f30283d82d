"""The report in the terminal at the end of a run: verdicts first, then measurements."""

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
from r2bspec.report.output import console, echo
from r2bspec.report.report_wording import own_pace
from r2bspec.report.terminal.cost_tables import harness_overhead_section, load_section
from r2bspec.report.terminal.header_and_footer import header, notes_section, overall, search_section
from r2bspec.report.terminal.hop_table import hop_sections
from r2bspec.report.terminal.monitor_tables import monitor_sections
from r2bspec.report.terminal.verdict_lines import verdict_section

_MIN_WIDTH = 60
"""Tables do not shrink below this; narrower terminals wrap."""

_PIPED_WIDTH = 100
"""The width of the text where there is no terminal."""

_WIDEST = 1000
"""The limit for the width of tables where there is no terminal."""


def show_result(result: Result, output_format: str, folder: Path | None = None) -> None:
    """Write a result to standard output.

    Args:
        result: what to write.
        output_format: ``text`` for the report, ``json`` for the content of ``result.json``.
        folder: the run folder, to be printed at the end; None for none.
    """
    if output_format == "json":
        # As bytes: JSON is UTF-8, whatever the encoding of the terminal.
        sys.stdout.buffer.write(to_json(result))
        sys.stdout.flush()
    elif sys.stdout.isatty():
        print_report(result, folder, _standard_output())
    else:
        _print_whole(result, folder)


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
    section = verdict_section(verdict, max(terminal.width, _MIN_WIDTH))
    for each in (Text(title, style="bold"), section, overall(verdict)):
        if each is not None:
            terminal.print(each)


def _print_whole(result: Result, folder: Path | None) -> None:
    """Write the report where no terminal limits its width: tables are not cut."""
    width = max(shutil.get_terminal_size((_PIPED_WIDTH, 24)).columns, _PIPED_WIDTH)
    echo(to_text(result, folder, width, whole_tables=True), nl=False)


def _standard_output() -> Console:
    """A console for standard output."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A terminal that cannot show ✔ gets a question mark, not a traceback.
        sys.stdout.reconfigure(errors="replace")
    colour = wants_colour(sys.stdout)
    return console(color_system="auto" if colour else None)


def print_report(
    result: Result, folder: Path | None, console: Console, *, whole_tables_from: int = 0
) -> None:
    """Print a result.

    Args:
        result: what to print.
        folder: the run folder, printed in the last line.
        console: to print to, with its width and colours.
        whole_tables_from: if it is not 0, the width of the report, which wider tables exceed up to
            the width of the console.
    """
    width = max(whole_tables_from or console.width, _MIN_WIDTH)
    sections = (
        header(result),
        verdict_section(result.verdict, width, own_pace(result.metrics)),
        *monitor_sections(result, width),
        *hop_sections(result.metrics),
        load_section(result.metrics, width),
        harness_overhead_section(result.floor),
        search_section(result.metrics.search),
        notes_section(result),
    )
    for section in sections:
        if section is not None:
            shown = max(width, _table_width(section, console)) if whole_tables_from else None
            console.print(section, width=shown)
            console.print()
    console.print(overall(result.verdict), width=width if whole_tables_from else None)
    if folder is not None:
        # Unwrapped, so that it can be copied.
        console.print(f"  {folder}", style="dim", soft_wrap=True, highlight=False, markup=False)


def _table_width(section: RenderableType, console: Console) -> int:
    """The width of the widest table of a section; 0 without tables."""
    parts = section.renderables if isinstance(section, Group) else [section]
    tables = [part for part in parts if isinstance(part, Table)]
    return max((console.measure(each).maximum for each in tables), default=0)


def to_text(
    result: Result, folder: Path | None = None, width: int = 100, *, whole_tables: bool = False
) -> str:
    """The report as plain text, without colours.

    Args:
        result: what to show.
        folder: the run folder, named in the last line.
        width: of the text, in columns.
        whole_tables: tables that are wider are not cut.
    """
    buffer = io.StringIO()
    columns = _WIDEST if whole_tables else width
    page = console(buffer, width=columns, color_system=None, legacy_windows=False)
    print_report(result, folder, page, whole_tables_from=width if whole_tables else 0)
    return "".join(f"{line.rstrip()}\n" for line in buffer.getvalue().splitlines())
