"""Findings as JSON, for programs.

One object: ``version`` (1), ``errors`` and ``warnings`` (counts) and ``findings``, each with
``code``, ``slug``, ``severity``, ``certainty``, ``message``, ``help``, ``file``, ``line``,
``column``, ``end_line``, ``end_column`` (all counted from 1, the end past the last character),
``path`` (keys and list indices from the root), ``related`` places and ``edit``, a safe
replacement, or null.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.report.findings.slugs import slug_of


def render(diagnostics: Iterable[Diagnostic], sources: Mapping[str, str]) -> str:
    """The findings as one JSON document; `sources` is not used."""
    del sources
    findings = [_finding(found) for found in diagnostics]
    report = {
        "version": 1,
        "errors": _count(findings, Severity.ERROR),
        "warnings": _count(findings, Severity.WARNING),
        "findings": findings,
    }
    return json.dumps(report, indent=2) + "\n"


def _finding(found: Diagnostic) -> dict[str, Any]:
    return {
        "code": found.code,
        "slug": slug_of(found.code),
        "severity": found.severity.value,
        "certainty": found.certainty.value,
        "message": found.message,
        "help": found.help,
        **_place(found.span),
        "path": list(found.path),
        "related": [{"message": one.message, **_place(one.span)} for one in found.related],
        "edit": {"text": found.edit.text, **_place(found.edit.span)} if found.edit else None,
    }


def _place(span: Span) -> dict[str, Any]:
    return {
        "file": span.file,
        "line": span.line,
        "column": span.column,
        "end_line": span.end_line,
        "end_column": span.end_column,
    }


def _count(findings: list[dict[str, Any]], severity: Severity) -> int:
    return sum(finding["severity"] == severity.value for finding in findings)
