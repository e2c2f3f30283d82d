"""Findings as text: place, message, source line with carets, and help.

::

    specs/a.r2b.yaml:12:5: error[R2B101 unknown-key]: unknown key 'node' in 'graph'
       |
    12 |     node:
       |     ^^^^
       = help: did you mean 'nodes'? known keys: placement, nodes

A source line is truncated to the width of a terminal.
"""

from __future__ import annotations

import os
import sys
import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import TextIO

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.diagnostics.code_pages import find_page
from r2bspec.diagnostics.diagnostic import split_lines
from r2bspec.diagnostics.quote import pluralize, printable
from r2bspec.report.output import write


def slug_of(code: str) -> str:
    """Return the slug of a code, such as ``unknown-key``; empty for a code without a page."""
    page = find_page(code)
    return page.slug if page is not None else ""


def code_with_slug(code: str) -> str:
    """Return the code with its slug, as shown to users: ``R2B101 unknown-key``."""
    return f"{code} {slug_of(code)}".rstrip()


MAX_WIDTH = 100
"""The most characters of a source line that are shown."""

_CONTEXT_BEFORE = 40  # characters kept before the span in a truncated line


def excerpt(span: Span, text: str) -> tuple[str, str] | None:
    """Return the line of a span and the carets under it; None if the text has no such line.

    A span of several lines is marked to the end of its first line.
    """
    lines = _source_lines(text)
    if not 0 < span.line <= len(lines):
        return None
    line = lines[span.line - 1].rstrip()
    if not line:
        return None
    start = min(span.column - 1, len(line))
    end = span.end_column - 1 if span.end_line == span.line else len(line)
    end = max(min(end, len(line)), start + 1)
    line, start, end = _window(line, start, end)
    shown = printable(line.replace("\t", " "))
    return shown, " " * _columns(shown[:start]) + "^" * max(_columns(shown[start:end]), 1)


def _window(line: str, start: int, end: int) -> tuple[str, int, int]:
    if len(line) <= MAX_WIDTH:
        return line, start, end
    first = min(max(start - _CONTEXT_BEFORE, 0), len(line) - MAX_WIDTH)
    cut = line[first : first + MAX_WIDTH]
    if first + MAX_WIDTH < len(line):
        cut = cut[:-1] + "…"
    if first:
        cut = "…" + cut[1:]
    return cut, start - first, min(end - first, MAX_WIDTH)


def _columns(text: str) -> int:
    """Return the columns that the text takes on a terminal."""
    if text.isascii():
        return len(text)
    wide = sum(unicodedata.east_asian_width(char) in "WF" for char in text)
    return len(text) + wide - sum(unicodedata.combining(char) > 0 for char in text)


_source_lines = lru_cache(maxsize=8)(split_lines)


_COLOURS = {Severity.ERROR: "31;1", Severity.WARNING: "33;1", Severity.INFO: "36;1"}
_QUIET = "34;1"
_BOLD = "1"


MAX_SHOWN = 100
"""The most findings of one file that are shown; other formats have all of them."""


def render_text(
    diagnostics: Iterable[Diagnostic], sources: Mapping[str, str], *, colour: bool = False
) -> str:
    """Return the findings in their order, a block of lines each; `sources` are texts by file name.

    If a file has very many, warnings are left out first, then findings further down.
    """
    by_file: dict[str, list[Diagnostic]] = {}
    for diagnostic in diagnostics:
        by_file.setdefault(diagnostic.span.file, []).append(diagnostic)
    blocks = []
    for file, findings in by_file.items():
        order = sorted(
            range(len(findings)), key=lambda place: _SEVERITIES.index(findings[place].severity)
        )
        shown, hidden = sorted(order[:MAX_SHOWN]), [findings[place] for place in order[MAX_SHOWN:]]
        blocks += [_block(findings[place], sources, colour=colour) for place in shown]
        if hidden:
            blocks.append(_hidden_text(file, hidden))
    return "\n".join(blocks)


_SEVERITIES = tuple(Severity)


def _hidden_text(file: str, hidden: Sequence[Diagnostic]) -> str:
    counts = Counter(diagnostic.severity for diagnostic in hidden)
    nouns = ((severity, counts[severity]) for severity in _SEVERITIES if counts[severity])
    those = " and ".join(pluralize(count, severity.value) for severity, count in nouns)
    return (
        f"{printable(file)}: {those} more; 'r2bspec validate --format json' lists all of a spec\n"
    )


def _block(finding: Diagnostic, sources: Mapping[str, str], *, colour: bool) -> str:
    def paint(text: str, style: str) -> str:
        return f"\x1b[{style}m{text}\x1b[0m" if colour else text

    def show(span: Span, style: str) -> list[str]:
        source_line = excerpt(span, sources.get(span.file, ""))
        if source_line is None:
            return []
        number = paint(str(span.line).rjust(width), _QUIET)
        return [
            f"{number} {bar} {source_line[0]}",
            f"{margin} {bar} {paint(source_line[1], style)}",
        ]

    width = max(len(str(span.line)) for span in (finding.span, *(r.span for r in finding.related)))
    margin = " " * width
    bar, equals = paint("|", _QUIET), paint("=", _QUIET)
    style = _COLOURS[finding.severity]
    label = paint(f"{finding.severity.value}[{code_with_slug(finding.code)}]", style)
    lines = [f"{_place(finding.span)}: {label}: {paint(printable(finding.message), _BOLD)}"]
    source_line = show(finding.span, style)
    if source_line:
        lines += [f"{margin} {bar}", *source_line]
    if finding.help:
        lines.append(f"{margin} {equals} help: {printable(finding.help)}")
    for related in finding.related:
        lines.append(f"{margin} {equals} {_place(related.span)}: {printable(related.message)}")
        lines += show(related.span, _QUIET)
    return "\n".join(lines) + "\n"


def _place(span: Span) -> str:
    return f"{printable(span.file)}:{span.line}:{span.column}"


def print_findings(
    diagnostics: Iterable[Diagnostic], sources: Mapping[str, str], stream: TextIO | None = None
) -> None:
    """Write findings as text to `stream`, standard error by default."""
    target = sys.stderr if stream is None else stream
    write(target, render_text(diagnostics, sources, colour=wants_colour(target)))


def wants_colour(stream: TextIO) -> bool:
    """Return whether to use colours: on a terminal, unless NO_COLOR, CI or TERM forbid it."""
    silenced = os.environ.get("NO_COLOR") or os.environ.get("CI") == "true"
    return stream.isatty() and not silenced and os.environ.get("TERM") != "dumb"
