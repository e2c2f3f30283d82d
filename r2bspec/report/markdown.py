"""Documents as Markdown for a pull request or a step summary, with long parts folded.

It is CommonMark with the tables and the folding of GitHub and GitLab. GitHub rejects comments of
more than 65,536 characters; tables are cut, with a count of the omitted rows, long before that.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from r2bspec.compare.report_input import ReportInput
from r2bspec.report.document import (
    Block,
    Cell,
    Chart,
    Detail,
    Document,
    Fold,
    Items,
    Paragraph,
    Table,
    Verbatim,
    within,
)
from r2bspec.report.result_document import result_document

_MAX_ROWS: Final = 60
"""The largest number of rows of a table."""


def render(report_input: ReportInput) -> bytes:
    """Return the report of a run."""
    return to_markdown(result_document(report_input, whole=True)).encode()


def to_markdown(document: Document) -> str:
    """Return a document as Markdown."""
    text = "\n".join(_lines(document))
    # GitLab carries out a line of a comment that begins with a slash, such as "/merge".
    return re.sub(r"\n{3,}", "\n\n", re.sub(r"(?m)^/", r"\/", text)).rstrip() + "\n"


def _lines(document: Document) -> Iterator[str]:
    yield f"### {escaped(document.line)}"
    yield ""
    for text in (*document.lead, document.title):
        if text:
            yield f"{escaped(text)}  "
    yield ""
    # What decides stands above the facts of machine and code.
    verdicts = [section for section in document.sections if not section.folded]
    for section in within(verdicts, Detail.COMMENT):
        yield from _blocks(section.blocks)
    if document.facts:
        yield " · ".join(map(escaped, document.facts))
        yield ""
    for section in within(document.sections, Detail.COMMENT):
        if section.folded:
            yield from _folded(section.title, section.blocks)


def _blocks(blocks: Iterable[Block], *, quoted: bool = True) -> Iterator[str]:
    for block in within([*blocks], Detail.COMMENT):
        match block:
            case Table():
                yield from _table(block.shown(Detail.COMMENT), titled=not quoted)
            case Paragraph():
                yield from (escaped(block.text), "")
            case Items():
                yield from (f"> {escaped(text)}  " for text in block.texts)
                yield ""
            case Verbatim():
                # Indented, so that nothing in the text ends the block or is markup.
                yield from (f"    {line}" for line in block.text.splitlines())
                yield ""
            case Fold():
                yield from _folded(block.title, block.blocks)
            case Chart():
                pass


def _folded(title: str, blocks: Sequence[Block]) -> Iterator[str]:
    """Yield blocks folded below a title; nothing if there are none."""
    content = [*_blocks(blocks, quoted=False)]
    if content:
        yield from (f"<details><summary>{escaped(title)}</summary>", "", *content)
        yield from ("</details>", "")


def _table(table: Table, *, titled: bool) -> Iterator[str]:
    """Yield a table, and below it the details of its rows, which cells have no room for."""
    if titled and table.title:
        aside = f": {escaped(table.aside)}" if table.aside else ""
        yield from (f"**{escaped(table.title)}**{aside}", "")
    yield f"| {' | '.join(escaped(column.title) for column in table.columns)} |"
    yield f"| {' | '.join('--:' if column.number else '---' for column in table.columns)} |"
    shown = table.rows[:_MAX_ROWS]
    yield from (f"| {' | '.join(map(_cell, row.cells))} |" for row in shown)
    yield ""
    if len(table.rows) > len(shown):
        yield from (f"{len(table.rows) - len(shown)} more rows are not shown.", "")
    explained = [row for row in shown if row.details]
    for row in explained:
        name = next((_cell(cell) for cell in row.cells if cell.code), _cell(row.cells[0]))
        yield f"- {name}: {' '.join(map(escaped, row.details))}"
    if explained:
        yield ""


def _cell(cell: Cell) -> str:
    text = code(cell.text) if cell.code else escaped(cell.text)
    return " ".join(filter(None, (escaped(cell.before), text, escaped(cell.after))))


def escaped(text: str) -> str:
    """Return text that Markdown shows literally: no markup, links or mentions, on one line."""
    line = " ".join(text.split())
    line = line.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    line = re.sub(r"([\\`*_\[\]|~#$])", r"\\\1", line)
    # Entities keep '@name' from being a mention, and 'http://' from being a link.
    return line.replace("@", "&#64;").replace("://", "&#58;//")


def code(text: str) -> str:
    """Return text in a code span, fit for the cell of a table."""
    line = " ".join(text.split()).replace("|", "\\|")
    longest = max((len(run) for run in re.findall(r"`+", line)), default=0)
    fence = "`" * (longest + 1)
    pad = " " if longest else ""
    return f"{fence}{pad}{line}{pad}{fence}"
