"""Explanations of YAML syntax errors.

PyYAML reports what its scanner expected, which rarely names the mistake. Each explainer below turns
the scanner's report, and the text around it, into a cause and a fix. The messages of libyaml and of
PyYAML's pure Python scanner differ; both are recognised.
"""

from __future__ import annotations

from collections.abc import Callable

import yaml

from r2bspec.diagnostics import Diagnostic, Span
from r2bspec.language.source_text import Source
from r2bspec.language.syntax import yaml_layout, yaml_marks
from r2bspec.language.syntax.scanner_report import ScannerReport

_EXPLAINERS: tuple[Callable[[ScannerReport], Diagnostic | None], ...] = (
    yaml_marks.tab_indentation,
    yaml_marks.reserved_character,
    yaml_marks.unclosed_quote,
    yaml_marks.unclosed_bracket,
    yaml_marks.stray_bracket,
    yaml_layout.unexpected_colon,
    yaml_layout.missing_colon,
    yaml_layout.wrong_indentation,
    yaml_layout.inline_list,
    yaml_marks.invalid_escape,
    yaml_marks.missing_anchor_name,
    yaml_layout.document_marker,
)
"""Tried in this order; the first that recognises the report explains it."""


def explain_syntax_error(error: yaml.YAMLError, source: Source) -> Diagnostic:
    """The diagnostic for an error of PyYAML's scanner or parser."""
    mark = getattr(error, "problem_mark", None)
    problem_span = _span(source, mark.line, mark.column) if mark else Span.of_file(source.file)
    began_mark = getattr(error, "context_mark", None)
    context_span = _span(source, began_mark.line, began_mark.column) if began_mark else problem_span
    report = ScannerReport(
        problem=str(getattr(error, "problem", None) or error),
        context=str(getattr(error, "context", None) or ""),
        problem_span=problem_span,
        context_span=context_span,
        source=source,
    )
    for case in _EXPLAINERS:
        found = case(report)
        if found is not None:
            return found
    return report.error("R2B010", f"invalid YAML: {report.problem}", "check the lines above")


def _span(source: Source, line: int, column: int) -> Span:
    """The span of one character; a place past the end of the text is moved to its last line."""
    last = len(source.lines)
    while last > 1 and not source.lines[last - 1].strip():
        last -= 1
    if line >= last:
        line, column = last - 1, len(source.lines[last - 1].rstrip())
    return Span(source.file, line + 1, column + 1, line + 1, column + 2)
