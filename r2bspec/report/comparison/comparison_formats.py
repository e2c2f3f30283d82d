"""A comparison in the requested format."""

from __future__ import annotations

from collections.abc import Sequence

from r2bspec.compare.comparison import Comparison
from r2bspec.diagnostics.plain_text import harmless, plain_values


def render(comparisons: Sequence[Comparison], name: str, width: int = 100) -> bytes:
    """The comparison as bytes, UTF-8.

    Args:
        comparisons: one for each result that was compared with the base; at least one.
        name: of the format, as `r2bspec compare --format` lists them.
        width: of lines of text, in columns.
    """
    if name == "json":
        from r2bspec.report.comparison.text import to_json

        return to_json(comparisons)
    shown = _render(plain_values(list(comparisons)), name, width).decode()
    return harmless(shown, commands=name == "github").encode()


def _render(comparisons: Sequence[Comparison], name: str, width: int) -> bytes:
    match name:
        case "markdown":
            from r2bspec.report.comparison.text import to_markdown

            return to_markdown(comparisons).encode()
        case "html":
            from r2bspec.report.comparison.html import to_html

            return to_html(comparisons)
        case "csv":
            from r2bspec.report.comparison.csv import to_csv

            return to_csv(comparisons)
        case "github":
            from r2bspec.report.comparison.github import to_github

            return to_github(comparisons)
        case "text":
            from r2bspec.report.comparison.text import to_text

            return to_text(comparisons, width).encode()
    raise ValueError(f"there is no format {name!r}")
