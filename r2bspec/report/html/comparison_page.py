"""A comparison as one self-contained page: tables only, no scripts, no network."""

from __future__ import annotations

import importlib.resources
from collections.abc import Iterator, Sequence
from html import escape

from r2bspec.compare.comparison import ADVICE, Comparison, ComparisonLine
from r2bspec.report.comparison_formats import OUTCOME_TEXTS, metric_text, numbers, summary, title

_HEADER = ("", "metric", "base", "head", "ratio", "bounds", "reason")

_STYLES = {"improved": "pass", "worse": "fail", "same": "", "can't tell": "inconclusive"}


def to_html(comparisons: Sequence[Comparison]) -> str:
    """The page, in the style of the report of a run."""
    return "\n".join([*_page(comparisons), ""])


def _page(comparisons: Sequence[Comparison]) -> Iterator[str]:
    style = importlib.resources.files("r2bspec.report.html").joinpath("style.css")
    yield '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">'
    yield '<meta name="viewport" content="width=device-width, initial-scale=1">'
    yield '<meta name="generator" content="r2bspec">'
    yield f"<title>Comparison with {_text(comparisons[0].base.source)}</title>"
    yield f"<style>\n{style.read_text('utf-8')}\n</style>\n</head>\n<body>\n<main>"
    for comparison in comparisons:
        yield f"<section>\n<h2>{_text(title(comparison))}</h2>\n<p>{_text(summary(comparison))}</p>"
        if comparison.differences:
            yield "<p>Differences between the runs:</p>\n<ul>"
            yield from (f"<li>{_text(difference)}</li>" for difference in comparison.differences)
            yield "</ul>"
        yield '<div class="wide" tabindex="0" role="region" aria-label="Table of metrics">'
        yield '<table border="1" cellspacing="0" cellpadding="4">\n<thead><tr>'
        yield from (f'<th scope="col">{header}</th>' for header in _HEADER)
        yield "</tr></thead>\n<tbody>"
        yield from map(_row, comparison.lines)
        yield "</tbody>\n</table>\n</div>\n</section>"
    yield f"<p>{_text(ADVICE)}</p>\n</main>\n</body>\n</html>"


def _row(line: ComparisonLine) -> str:
    cells = "".join(f'<td class="n">{_text(number) or "–"}</td>' for number in numbers(line))
    return (
        f'<tr class="{_STYLES[line.outcome]}"><td class="outcome"><strong>'
        f"{_text(OUTCOME_TEXTS[line.outcome])}</strong></td>"
        f'<th scope="row" align="left"><code>{_text(metric_text(line))}</code></th>'
        f"{cells}<td>{_text(line.reason)}</td></tr>"
    )


def _text(text: str) -> str:
    """Text as HTML shows it; control characters, which HTML cannot contain, are replaced."""
    plain = "".join(
        character if character.isprintable() else "\N{REPLACEMENT CHARACTER}" for character in text
    )
    return escape(plain)
