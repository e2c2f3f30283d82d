"""Findings of the compiler as diagnostics of the protocol."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from lsprotocol import types

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.diagnostics.code_pages import find_page, page_file
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.positions import TextPositions

_SEVERITIES: Final = {
    Severity.ERROR: types.DiagnosticSeverity.Error,
    Severity.WARNING: types.DiagnosticSeverity.Warning,
    Severity.INFO: types.DiagnosticSeverity.Information,
}

PositionsOf = Callable[[str], TextPositions]
"""The positions in the text of a file."""


def diagnostics_by_file(
    analysis: Analysis, positions_of: PositionsOf
) -> Mapping[str, list[types.Diagnostic]]:
    """Return the diagnostics of every file of an analysis.

    A file without findings has an empty list.
    """
    diagnostics: dict[str, list[types.Diagnostic]] = {
        name: [] for name in analysis.sources if is_file(name)
    }
    diagnostics.setdefault(str(analysis.path), [])
    for diagnostic in analysis.diagnostics:
        # A finding in an option has no place in a file.
        file = diagnostic.span.file if is_file(diagnostic.span.file) else str(analysis.path)
        diagnostics.setdefault(file, []).append(to_diagnostic(diagnostic, file, positions_of))
    return diagnostics


def to_diagnostic(diagnostic: Diagnostic, file: str, positions_of: PositionsOf) -> types.Diagnostic:
    """Convert a finding."""
    span = diagnostic.span if diagnostic.span.file == file else Span.of_file(file)
    return types.Diagnostic(
        range=positions_of(file).range(_visible(span)),
        severity=_SEVERITIES[diagnostic.severity],
        code=diagnostic.code,
        code_description=types.CodeDescription(page_file(diagnostic.code).as_uri()),
        source="r2bspec",
        # Not with a capital: a message may begin with a name of the spec.
        message=f"{diagnostic.message}\n{diagnostic.help}"
        if diagnostic.help
        else diagnostic.message,
        tags=[types.DiagnosticTag.Unnecessary] if _is_unused(diagnostic) else None,
        related_information=[
            types.DiagnosticRelatedInformation(
                types.Location(
                    uri(place.span.file), positions_of(place.span.file).range(place.span)
                ),
                place.message,
            )
            for place in diagnostic.related
            if is_file(place.span.file)
        ]
        or None,
    )


def uri(file: str) -> str:
    """Return the URI of a file."""
    return Path(file).absolute().as_uri()


def is_file(name: str) -> bool:
    """Return True if a span is in a file, not in an option or the environment."""
    return name.startswith("/")


def _visible(span: Span) -> Span:
    """Return a span with at least one character, so that editors can underline it."""
    if (span.line, span.column) == (span.end_line, span.end_column):
        return Span(span.file, span.line, span.column, span.line, span.column + 1)
    return span


def _is_unused(diagnostic: Diagnostic) -> bool:
    page = find_page(diagnostic.code)
    return page is not None and "unused" in page.slug.split("-")
