"""Converts a finding at a path into a diagnostic at a line and column."""

from __future__ import annotations

from typing import TYPE_CHECKING

from r2bspec.check.finding import Finding
from r2bspec.diagnostics.diagnostic import (
    Certainty,
    Diagnostic,
    Edit,
    Path,
    Related,
    Severity,
    Span,
)
from r2bspec.language.located_tree import ScalarNode, lookup

if TYPE_CHECKING:
    from r2bspec.language.load_spec import LoadedSpec


def to_diagnostic(
    finding: Finding, code: str, severity: Severity, loaded: LoadedSpec
) -> Diagnostic:
    """The diagnostic of a finding; code and severity of the rule are the defaults."""
    span = _span(finding, loaded)
    related = [
        Related(each.message, loaded.span(each.path, key=each.key)) for each in finding.related
    ]
    return Diagnostic(
        code=finding.code or code,
        severity=Severity(finding.severity or severity),
        message=finding.message,
        span=span,
        path=finding.path,
        help=finding.help,
        related=tuple(related + ([] if finding.key else _origin(finding.path, loaded))),
        edit=_edit(finding, span, loaded),
        certainty=Certainty.ENVIRONMENT if finding.machine_dependent else Certainty.CERTAIN,
    )


def _span(finding: Finding, loaded: LoadedSpec) -> Span:
    if finding.part is not None:
        return loaded.span_inside(finding.path, *finding.part)
    return loaded.span(finding.path, key=finding.key)


def _origin(path: Path, loaded: LoadedSpec) -> list[Related]:
    """Where the variable is set from which the value at `path` comes."""
    node = lookup(loaded.tree, path) if loaded.tree is not None else None
    return [node.origin] if isinstance(node, ScalarNode) and node.origin is not None else []


def _edit(finding: Finding, span: Span, loaded: LoadedSpec) -> Edit | None:
    """The replacement, if the text at `span` is exactly the text to replace."""
    if finding.replacement is None or loaded.tree is None or span.line != span.end_line:
        return None
    node = lookup(loaded.tree, finding.path)
    source = loaded.sources.get(span.file)
    if source is None or not isinstance(node, ScalarNode) or node.origin is not None:
        return None
    offset, length = finding.part or (0, len(node.text))
    written = source.line(span.line)[span.column - 1 : span.end_column - 1]
    exact = written == node.text[offset : offset + length]
    return Edit(span, finding.replacement) if exact else None
