"""A page of tables: self-contained, without scripts, and made by the standard library alone."""

from __future__ import annotations

import importlib.resources
from collections.abc import Container, Iterable
from html import escape


def plain_page(title: str, sections: Iterable[str]) -> str:
    """A page in the style of the report of a run.

    Args:
        title: as text, of the window.
        sections: as HTML, its content.
    """
    style = importlib.resources.files("r2bspec.report.html").joinpath("style.css")
    return "\n".join(
        (
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f'<meta name="generator" content="r2bspec">\n<title>{escape(title)}</title>',
            f"<style>\n{style.read_text('utf-8')}\n</style>\n</head>\n<body>",
            *sections,
            "</body>\n</html>\n",
        )
    )


def plain_table(
    label: str, columns: Iterable[str], numbers: Container[str], rows: Iterable[str]
) -> str:
    """A table, which scrolls where it is wider than the page.

    Args:
        label: as text, what it is a table of.
        columns: as text, their headings.
        numbers: the columns that have numbers.
        rows: as HTML, whole.
    """
    header = "".join(
        f'<th scope="col"{number_class(column, numbers)}>{escape(column)}</th>'
        for column in columns
    )
    return "\n".join(
        (
            f'<div class="wide" tabindex="0" role="region" aria-label="{escape(label)}">',
            f'<table border="1" cellspacing="0" cellpadding="4">\n<thead><tr>{header}</tr></thead>',
            "<tbody>",
            *rows,
            "</tbody>\n</table>\n</div>",
        )
    )


def number_class(column: str, numbers: Container[str]) -> str:
    """The attribute of a cell: numbers are aligned at their ends."""
    return ' class="n"' if column in numbers else ""
