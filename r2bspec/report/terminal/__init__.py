"""The report in the terminal at the end of a run: verdicts first, then measurements."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import msgspec
from rich.console import Console
from rich.text import Text

from r2bspec.diagnostics.plain_text import escaped_json
from r2bspec.judge.judge_run import to_json
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import Verdict
from r2bspec.report.findings.print_findings import wants_colour
from r2bspec.report.output import console
from r2bspec.report.report_wording import own_pace
from r2bspec.report.terminal.cost_tables import harness_overhead_section, load_section
from r2bspec.report.terminal.header_and_footer import header, notes_section, overall, search_section
from r2bspec.report.terminal.hop_table import hop_sections
from r2bspec.report.terminal.monitor_tables import monitor_sections
from r2bspec.report.terminal.verdict_lines import verdict_section

_MIN_WIDTH = 60
"""Tables do not shrink below this; narrower terminals wrap."""


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
    else:
        print_report(result, folder, _standard_output())


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


def _standard_output() -> Console:
    """A console for standard output."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A terminal that cannot show ✔ gets a question mark, not a traceback.
        sys.stdout.reconfigure(errors="replace")
    colour = wants_colour(sys.stdout)
    return console(color_system="auto" if colour else None)


def print_report(result: Result, folder: Path | None, console: Console) -> None:
    """Print a result.

    Args:
        result: what to print.
        folder: the run folder, printed in the last line.
        console: to print to, with its width and colours.
    """
    width = max(console.width, _MIN_WIDTH)
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
            console.print(section)
            console.print()
    console.print(overall(result.verdict))
    if folder is not None:
        # Unwrapped, so that it can be copied.
        console.print(f"  {folder}", style="dim", soft_wrap=True, highlight=False, markup=False)


def to_text(result: Result, folder: Path | None = None, width: int = 100) -> str:
    """The report as plain text, without colours."""
    buffer = io.StringIO()
    page = console(buffer, width=width, color_system=None, legacy_windows=False)
    print_report(result, folder, page)
    return "".join(f"{line.rstrip()}\n" for line in buffer.getvalue().splitlines())
