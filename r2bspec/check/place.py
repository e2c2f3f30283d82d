"""From a finding at a path to a diagnostic at a line and column."""

from __future__ import annotations

from typing import TYPE_CHECKING

from r2bspec.check.finding import Finding
from r2bspec.diagnostics.model import Diagnostic, Edit, Related, Severity, Span

if TYPE_CHECKING:
    from r2bspec.spec.load import Loaded


def place(finding: Finding, code: str, severity: Severity, loaded: Loaded) -> Diagnostic:
    """The diagnostic of a finding, with the rule's code and severity where it has none."""
    span = loaded.span(finding.path, key=finding.key)
    return Diagnostic(
        code=finding.code or code,
        severity=finding.severity or severity,
        message=finding.message,
        span=span,
        path=finding.path,
        help=finding.help,
        related=tuple(
            Related(each.message, loaded.span(each.path, key=each.key)) for each in finding.related
        ),
        certainty=finding.certainty,
    )
