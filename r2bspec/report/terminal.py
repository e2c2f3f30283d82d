"""Documents in a terminal, and as plain text."""

from __future__ import annotations

import io
import shutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.table import Table as Grid
from rich.text import Text

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import to_json
from r2bspec.judge.result import Result
from r2bspec.report.document import (
    ROOMY_COLUMNS,
    Block,
    Cell,
    Chart,
    Detail,
    Document,
    Fold,
    Items,
    Paragraph,
    Row,
    Table,
    Verbatim,
    within,
)
from r2bspec.report.findings_text import wants_colour
from r2bspec.report.output import (
    MAX_TABLE_ROWS,
    console,
    echo,
    echo_document,
    printed_text,
    rows_left_out,
)
from r2bspec.report.result_document import result_document

_MIN_WIDTH: Final = 60
"""Tables do not shrink below this; narrower terminals wrap."""

_PIPED_WIDTH: Final = ROOMY_COLUMNS
"""The width of the text where there is no terminal."""

_WIDEST: Final = 1000
"""The limit for the width of tables where there is no terminal."""

_MIN_WORDS: Final = 16
"""The narrowest column of words."""

_GAP: Final = 2
_QUIET: Final = "dim"
_STYLES: Final = {
    "pass": "bold green",
    "fail": "bold red",
    "inconclusive": "bold yellow",
    "invalid": "bold magenta",
    "incomplete": "bold magenta",
    "error": "bold red",
}


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
    else:
        document = result_document(ReportInput(result=result, verbose=verbose))
        show_document(document, str(folder) if folder is not None else "")


def show_document(document: Document, end: str = "") -> None:
    """Write a document to standard output, with `end` and the outcome as its last line."""
    if sys.stdout.isatty():
        if isinstance(sys.stdout, io.TextIOWrapper):
            # A terminal that cannot show ✔ gets a question mark, not a traceback.
            sys.stdout.reconfigure(errors="replace")
        page = console(color_system="auto" if wants_colour(sys.stdout) else None)
        _print(document, page, page.width, end)
    else:
        echo(to_text(document, end, _piped_width(), whole_tables=True), nl=False)


def _piped_width() -> int:
    return max(shutil.get_terminal_size((_PIPED_WIDTH, 24)).columns, _PIPED_WIDTH)


def to_text(
    document: Document, end: str = "", width: int = _PIPED_WIDTH, *, whole_tables: bool = False
) -> str:
    """Return a document as plain text, without colours.

    Args:
        document: what to show.
        end: see `show_document`.
        width: the width of the text, in columns.
        whole_tables: tables that are wider are not cut.
    """
    return printed_text(
        lambda page: _print(document, page, width, end), _WIDEST if whole_tables else width
    )


def render(report_input: ReportInput) -> bytes:
    """Return the terminal report without colours; wide tables are not cut."""
    return to_text(result_document(report_input), whole_tables=True).encode()


def _print(document: Document, page: Console, width: int, end: str) -> None:
    width = max(width, _MIN_WIDTH)
    word = Text(document.word, style=_STYLES.get(document.outcome, "bold"))
    # One line, however long, where no terminal would wrap it: it is what logs are searched for.
    line = Text.assemble(word, (document.line.removeprefix(document.word), "bold"))
    page.print(line, soft_wrap=page.width > width)
    parts = [(text, "") for text in document.lead]
    parts += [(document.title, "bold"), (" · ".join(document.facts), _QUIET)]
    for text, style in parts:
        if text:
            page.print(Text(text, style=style), width=width)
    detail = Detail.ROOMY if width >= ROOMY_COLUMNS else Detail.ALWAYS
    for section in within(document.sections, detail):
        for place, block in enumerate(within(section.blocks, detail)):
            if place == 0 or not (isinstance(block, Paragraph) and block.quiet):
                page.print()
            if isinstance(block, Items):
                page.print(_heading(section.title.lower()))
            for part in _shown(block, width, detail):
                page.print(part, width=_widest(part, width, page))
    if end:
        # Unwrapped, so that it can be copied. The outcome once more: its line may be out of sight.
        page.print()
        page.print(Text.assemble(word, "  ", (end, _QUIET)), soft_wrap=True)


def _widest(part: RenderableType, width: int, page: Console) -> int:
    """Return the width for a part: a table may be wider than the text where nothing cuts it."""
    if isinstance(part, Grid) and page.width > width:
        return max(width, page.measure(part).maximum)
    return width


def _heading(text: str, aside: str = "") -> Text:
    return Text.assemble((text, "bold"), (f"  {aside}" if aside else "", _QUIET))


def _shown(block: Block, width: int, detail: Detail) -> Iterator[RenderableType]:
    """Yield what a block shows, one below the other."""
    match block:
        case Table():
            table = block.shown(detail)
            if table.title:
                yield _heading(table.title, table.aside)
            yield from _grids(table, width)
        case Paragraph():
            yield Text(block.text, style=_QUIET if block.quiet else "")
        case Items():
            yield from (Padding(Text(text), (0, 0, 0, _GAP), expand=False) for text in block.texts)
        case Verbatim():
            yield Padding(Text(block.text), (0, 0, 0, _GAP), expand=False)
        case Fold():
            yield _heading(block.title)
            for inner in within(block.blocks, detail):
                yield from _shown(inner, width, detail)
        case Chart():
            pass


def _grids(table: Table, width: int) -> Iterator[RenderableType]:
    """Yield the rows of a table, all in columns of the same widths, with details between them."""
    header = Row(tuple(Cell(column.title) for column in table.columns), quiet=True)
    shown = table.rows[:MAX_TABLE_ROWS]
    widths = _widths(table, (header, *shown), width)
    grid = _new_grid(table, widths)
    for row in (header, *shown):
        grid.add_row(*_texts(row))
        if row.details:
            yield grid
            reason, *more = row.details
            lines = Group(Text(reason), *(Text(text, style=_QUIET) for text in more))
            yield Padding(lines, (0, 0, 0, 2 * _GAP), expand=False)
            grid = _new_grid(table, widths)
    if grid.rows:
        yield grid
    if len(table.rows) > len(shown):
        yield Text(rows_left_out(len(table.rows) - len(shown)), style=_QUIET)


def _new_grid(table: Table, widths: Sequence[int]) -> Grid:
    grid = Grid.grid(padding=(0, _GAP, 0, 0), pad_edge=False)
    for column, width in zip(table.columns, widths, strict=True):
        justify = "right" if column.number else "left"
        grid.add_column(width=width, justify=justify, no_wrap=column.number, overflow="fold")  # type: ignore[arg-type]
    return grid


def _texts(row: Row) -> Iterator[Text]:
    for place, cell in enumerate(row.cells):
        if row.quiet:
            yield Text(cell.words, style=_QUIET)
        elif place == 0 and row.outcome:
            yield Text(cell.words, style=_STYLES.get(row.outcome, ""))
        else:
            before = (f"{cell.before} ", _QUIET) if cell.before else ""
            after = (f" {cell.after}", _QUIET) if cell.after else ""
            yield Text.assemble(before, cell.text, after)


def _widths(table: Table, rows: Sequence[Row], width: int) -> list[int]:
    """Return the widths of the columns; without enough room, the widest words are wrapped."""
    widths = [
        max(Text(row.cells[place].words).cell_len for row in rows)
        for place in range(len(table.columns))
    ]
    excess = sum(widths) + _GAP * (len(widths) - 1) - width
    words = [place for place, column in enumerate(table.columns) if not column.number]
    for place in sorted(words, key=lambda place: -widths[place]):
        if excess > 0:
            narrower = max(min(widths[place], _MIN_WORDS), widths[place] - excess)
            excess -= widths[place] - narrower
            widths[place] = narrower
    return widths
