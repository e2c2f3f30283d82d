"""Output that several verbs share: findings, columns of text, numbers of things."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from r2bspec.diagnostics.plain_text import plain
from r2bspec.diagnostics.quote import clip
from r2bspec.report.output import MAX_TABLE_ROWS, echo, echo_document, rows_left_out

if TYPE_CHECKING:
    from r2bspec.diagnostics import Diagnostic
    from r2bspec.language.load_spec import LoadedSpec


_MAX_CELL = 100


def styled(text: str, **style: Any) -> str:
    """Return a text with a style of click for standard output, if that has colours."""
    from r2bspec.report.findings_text import wants_colour

    return click.style(text, **style) if wants_colour(sys.stdout) else text


def aligned_lines(rows: Sequence[Sequence[str]], right_columns: Collection[int] = ()) -> list[str]:
    """Return a line for each row, with columns as wide as a terminal shows their widest cell.

    Long cells are clipped. Of very many rows the first are shown, with the number of the others.

    Args:
        rows: the cells; all rows have the same number. The first is the header.
        right_columns: the columns that are aligned to the right.
    """
    from rich.cells import cell_len

    rows, more = rows[: MAX_TABLE_ROWS + 1], len(rows) - MAX_TABLE_ROWS - 1
    rows = [[clip(cell, _MAX_CELL) for cell in row] for row in rows]
    widths = [max(map(cell_len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = []
        for column, (cell, width) in enumerate(zip(row, widths, strict=True)):
            padding = " " * (width - cell_len(cell))
            cells.append(padding + cell if column in right_columns else cell + padding)
        lines.append("  ".join(cells).rstrip())
    return [*lines, rows_left_out(more)] if more > 0 else lines


def print_table(
    header: Sequence[str], rows: Sequence[Sequence[str]], right_columns: Collection[int] = ()
) -> None:
    """Print rows below a header; a narrow terminal wraps the lines."""
    first, *lines = aligned_lines([header, *rows], right_columns)
    echo(styled(plain(first), bold=True), styled=True)
    for line in lines:
        echo(line)


def show_findings(findings: Sequence[Diagnostic], loaded: LoadedSpec | None) -> None:
    """Print findings about a document to standard error, with the lines that they are about."""
    from r2bspec.report.findings_text import print_findings as show

    show(findings, loaded.texts if loaded is not None else {})


def print_findings(
    output_format: str,
    findings: Sequence[Diagnostic],
    sources: Mapping[str, str],
    names: Sequence[str],
    *,
    err: bool = False,
) -> None:
    """Print the findings about files, in one of the formats of `finding_formats`.

    Args:
        output_format: the name of the format.
        findings: what to print.
        sources: the texts that the findings refer to, by file name.
        names: all files that were checked.
        err: to standard error instead of standard output.
    """
    from r2bspec.report import finding_formats
    from r2bspec.report.findings_text import wants_colour

    colour = output_format == "text" and wants_colour(sys.stderr if err else sys.stdout)
    shown = finding_formats.render(output_format, findings, sources, names, colour=colour)
    if output_format in {"json", "sarif"} and not err:
        echo_document(shown, nl=False)
    else:
        echo(shown, err=err, nl=False, styled=colour, commands=output_format == "github")


@contextlib.contextmanager
def queued_host(
    name: str, seconds: float, wait_s: float | None, *, quiet: bool = False
) -> Iterator[None]:
    """Hold this host for the block; show the place in its queue until then.

    Args:
        name: the name of the benchmark, for those who wait.
        seconds: how long it will take.
        wait_s: how long to wait for others; None to run next to them.
        quiet: show nothing.

    Raises:
        HostBusyError: others have the host for longer.
    """
    from r2bspec import api
    from r2bspec.report.progress import shown_progress

    with contextlib.ExitStack() as host:
        with shown_progress(quiet=quiet) as progress:
            host.enter_context(api.queued_host(name, seconds, wait_s, progress))
        yield
