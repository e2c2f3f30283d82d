"""A report as blocks, which the terminal, Markdown and HTML show each in its own way.

A report is made as a `Document`; `terminal`, `markdown` and `html.page` render it. A block has a
`detail`: how much room a report needs to show it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, TypeVar

from r2bspec.judge.measure.units import show


class Detail(IntEnum):
    """The reports that show a block or a column: each shows what those before it show, too."""

    ALWAYS = 0
    ROOMY = 1
    """Not terminals of less than `ROOMY_COLUMNS` columns."""
    COMMENT = 2
    """Markdown, and pages."""
    PAGE = 3
    """Pages alone."""


ROOMY_COLUMNS: Final = 100


@dataclass(frozen=True, slots=True)
class Cell:
    """The content of a cell.

    Attributes:
        text: the value as people read it.
        value: the exact value, where it is a number of a result.
        path: of that number in ``result.json``, a JSON pointer without its first slash.
        before: words before it, quieter, such as the objective of a requirement.
        after: words after it, quieter, such as the bounds of an estimate.
        code: whether the text is quoted from a spec.
        link: where it leads, in a page.
    """

    text: str
    value: float | None = None
    path: str = ""
    before: str = ""
    after: str = ""
    code: bool = False
    link: str = ""

    @property
    def words(self) -> str:
        """The whole cell as plain text."""
        return " ".join(filter(None, (self.before, self.text, self.after)))


def number(value: float | None, unit: str, path: str = "") -> Cell:
    """Return the cell of a value of a result; a dash without a value."""
    return Cell(show(value, unit), value, path if value is not None else "")


@dataclass(frozen=True, slots=True)
class Column:
    """A column: numbers are aligned at their ends, and are not wrapped."""

    title: str
    number: bool = True
    detail: Detail = Detail.ALWAYS


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a table.

    Attributes:
        cells: one for each column.
        details: sentences about the row.
        outcome: colours the first cell of the row; empty for none.
        quiet: whether it only adds to the row above.
    """

    cells: tuple[Cell, ...]
    details: tuple[str, ...] = ()
    outcome: str = ""
    quiet: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """A table with its heading; its first column names the row."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    aside: str = ""
    detail: Detail = Detail.ALWAYS

    def shown(self, detail: Detail) -> Table:
        """Return the table without the columns for which a report of this detail has no room."""
        places = [place for place, column in enumerate(self.columns) if column.detail <= detail]
        rows = tuple(
            Row(tuple(row.cells[place] for place in places), row.details, row.outcome, row.quiet)
            for row in self.rows
        )
        return Table(self.title, tuple(self.columns[place] for place in places), rows, self.aside)


@dataclass(frozen=True, slots=True)
class Paragraph:
    """A sentence or more."""

    text: str
    quiet: bool = False
    detail: Detail = Detail.ALWAYS


@dataclass(frozen=True, slots=True)
class Items:
    """Sentences that do not depend on each other."""

    texts: tuple[str, ...]
    detail: Detail = Detail.ALWAYS


@dataclass(frozen=True, slots=True)
class Verbatim:
    """Literal lines: a log, or a spec."""

    text: str
    detail: Detail = Detail.ALWAYS


@dataclass(frozen=True, slots=True)
class Chart:
    """A drawing; only pages have it.

    Attributes:
        name: unique in the page.
        title: the heading of the figure.
        svg: the drawing itself.
        description: the description of the content, in words.
        note: what is omitted, or how to read it; may be empty.
        wide: whether it scrolls where the window is narrower.
    """

    name: str
    title: str
    svg: str
    description: str = ""
    note: str = ""
    wide: bool = False
    detail: Detail = Detail.PAGE


@dataclass(frozen=True, slots=True)
class Fold:
    """Blocks that are folded below a title in reports that can fold."""

    title: str
    blocks: tuple[Block, ...]
    detail: Detail = Detail.ALWAYS


Block = Table | Paragraph | Items | Verbatim | Chart | Fold


@dataclass(frozen=True, slots=True)
class Section:
    """Blocks with a heading; `folded` in Markdown, where a comment is to stay short."""

    title: str
    blocks: tuple[Block, ...]
    folded: bool = False
    detail: Detail = Detail.ALWAYS


@dataclass(frozen=True, slots=True)
class Document:
    """A report.

    Attributes:
        line: the first line, in which `word` is the outcome with its mark.
        word: the beginning of `line`; empty for none.
        outcome: which colours `word`.
        lead: sentences below the first line, the most important first.
        title: what people call the benchmark; empty for none.
        facts: the facts of machine, data and code, in few words each.
        back: a link to the page of the suite.
        footer: the last line of a page.
    """

    line: str
    word: str = ""
    outcome: str = ""
    lead: tuple[str, ...] = ()
    title: str = ""
    facts: tuple[str, ...] = ()
    sections: tuple[Section, ...] = ()
    back: str = ""
    footer: str = ""


_Detailed = TypeVar("_Detailed", Section, Block)


def within(blocks: Iterable[_Detailed], detail: Detail) -> Sequence[_Detailed]:
    """Return the blocks or sections that a report of this detail shows."""
    return [block for block in blocks if block.detail <= detail]
