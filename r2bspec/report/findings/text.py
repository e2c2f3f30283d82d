"""Findings as text: place, message, source line with carets, and help.

::

    specs/a.r2b.yaml:12:5: error[R2B101 unknown-key]: unknown key 'node' in 'graph'
       |
    12 |     node:
       |     ^^^^
       = help: did you mean 'nodes'? known keys: placement, nodes
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.diagnostics.quote import printable
from r2bspec.report.findings.slugs import code_with_slug
from r2bspec.report.findings.source_excerpt import excerpt

_COLOURS = {Severity.ERROR: "31;1", Severity.WARNING: "33;1", Severity.INFO: "36;1"}
_QUIET = "34;1"
_BOLD = "1"


def render(
    diagnostics: Iterable[Diagnostic], sources: Mapping[str, str], *, colour: bool = False
) -> str:
    """The findings in their order, a block of lines each; `sources` are texts by file name."""
    return "\n".join(_block(found, sources, colour=colour) for found in diagnostics)


def _block(found: Diagnostic, sources: Mapping[str, str], *, colour: bool) -> str:
    def paint(text: str, style: str) -> str:
        return f"\x1b[{style}m{text}\x1b[0m" if colour else text

    def show(span: Span, style: str) -> list[str]:
        seen = excerpt(span, sources.get(span.file, ""))
        if seen is None:
            return []
        number = paint(str(span.line).rjust(width), _QUIET)
        return [f"{number} {bar} {seen[0]}", f"{margin} {bar} {paint(seen[1], style)}"]

    width = max(len(str(span.line)) for span in (found.span, *(r.span for r in found.related)))
    margin = " " * width
    bar, equals = paint("|", _QUIET), paint("=", _QUIET)
    style = _COLOURS[found.severity]
    label = paint(f"{found.severity.value}[{code_with_slug(found.code)}]", style)
    lines = [f"{_place(found.span)}: {label}: {paint(printable(found.message), _BOLD)}"]
    source_line = show(found.span, style)
    if source_line:
        lines += [f"{margin} {bar}", *source_line]
    if found.help:
        lines.append(f"{margin} {equals} help: {printable(found.help)}")
    for one in found.related:
        lines.append(f"{margin} {equals} {_place(one.span)}: {printable(one.message)}")
        lines += show(one.span, _QUIET)
    return "\n".join(lines) + "\n"


def _place(span: Span) -> str:
    return f"{printable(span.file)}:{span.line}:{span.column}"
