"""Findings as workflow commands, which GitHub shows at the lines of a change.

GitHub keeps ten annotations of each step and drops the rest silently. Errors therefore come first,
and a last line gives the number of findings without an annotation.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from r2bspec.diagnostics import Diagnostic, Severity
from r2bspec.report.findings.slugs import code_with_slug

MAX_ANNOTATIONS = 10
"""Annotations of a step that GitHub keeps."""

_COMMANDS = {Severity.ERROR: "error", Severity.WARNING: "warning", Severity.INFO: "notice"}
_ORDER = tuple(_COMMANDS)


def render(diagnostics: Iterable[Diagnostic], sources: Mapping[str, str]) -> str:
    """The findings as workflow commands; the texts of `sources` are not needed."""
    del sources
    ordered = sorted(diagnostics, key=lambda found: _ORDER.index(found.severity))
    lines = [_command(found) for found in ordered[:MAX_ANNOTATIONS]]
    if len(ordered) > MAX_ANNOTATIONS:
        lines.append(
            f"{len(ordered) - MAX_ANNOTATIONS} more findings are not annotated; see the log"
        )
    return "".join(f"{line}\n" for line in lines)


def _command(found: Diagnostic) -> str:
    span = found.span
    properties = {
        "file": span.file,
        "line": span.line,
        "endLine": span.end_line,
        "col": span.column,
        "endColumn": span.end_column,
        "title": code_with_slug(found.code),
    }
    if span.end_line != span.line:  # GitHub refuses columns for a span of several lines
        del properties["col"], properties["endColumn"]
    shown = ",".join(f"{key}={_property(str(value))}" for key, value in properties.items())
    text = f"{found.message}\n{found.help}" if found.help else found.message
    return f"::{_COMMANDS[found.severity]} {shown}::{_data(text)}"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")
