"""Diagnostics: problems with their place, their message and a fix."""

from r2bspec.diagnostics.diagnostic import (
    Certainty,
    Diagnostic,
    Edit,
    Path,
    Related,
    Severity,
    Span,
    format_path,
)
from r2bspec.diagnostics.quote import did_you_mean

__all__ = [
    "Certainty",
    "Diagnostic",
    "Edit",
    "Path",
    "Related",
    "Severity",
    "Span",
    "did_you_mean",
    "format_path",
]
