"""Findings as SARIF 2.1.0, which code-scanning services show at the lines of a change.

Each code that occurs is a rule with its page of `r2bspec explain`. Columns are counted in Unicode
code points; relative file names are relative to the working directory of `validate`. The
fingerprint of a result consists of its code, file, path and message, not of its line, so that it
does not change when lines are inserted above it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import PurePosixPath
from typing import Any
from urllib.parse import quote

from r2bspec._version import __version__
from r2bspec.diagnostics import Diagnostic, Severity, Span, format_path
from r2bspec.diagnostics.code_pages import find_page

SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"
_LEVELS = {Severity.ERROR: "error", Severity.WARNING: "warning", Severity.INFO: "note"}


def render(
    diagnostics: Iterable[Diagnostic], sources: Mapping[str, str], files: Iterable[str] = ()
) -> str:
    """The findings as one SARIF log with one run; `files` are all files that were checked."""
    del sources
    found = list(diagnostics)
    codes = sorted({one.code for one in found})
    log = {
        "$schema": SCHEMA,
        "version": "2.1.0",
        "runs": [
            {
                "tool": {
                    "driver": {
                        "name": "r2bspec",
                        "semanticVersion": __version__,
                        "rules": [_rule(code) for code in codes],
                    }
                },
                "columnKind": "unicodeCodePoints",
                "artifacts": [{"location": _location(file)} for file in dict.fromkeys(files)],
                "results": [_result(one, codes.index(one.code)) for one in found],
            }
        ],
    }
    return json.dumps(log, indent=2) + "\n"


def _rule(code: str) -> dict[str, Any]:
    page = find_page(code)
    if page is None:
        return {"id": code}
    return {
        "id": code,
        "name": page.slug,
        "shortDescription": {"text": page.title},
        "fullDescription": {"text": page.why},
        "help": {"text": f"'r2bspec explain {code}' shows a failing and a passing example."},
        "defaultConfiguration": {"level": _LEVELS[page.severity]},
    }


def _result(found: Diagnostic, rule: int) -> dict[str, Any]:
    text = f"{found.message}; {found.help}" if found.help else found.message
    path = format_path(found.path)
    result: dict[str, Any] = {
        "ruleId": found.code,
        "ruleIndex": rule,
        "level": _LEVELS[found.severity],
        "message": {"text": text},
        "locations": [_place(found.span) | ({"logicalLocations": [_name(path)]} if path else {})],
        "partialFingerprints": {"codePathMessage/v1": _fingerprint(found, path)},
        "properties": {"certainty": found.certainty.value},
    }
    if found.related:
        result["relatedLocations"] = [
            _place(one.span) | {"id": number, "message": {"text": one.message}}
            for number, one in enumerate(found.related, start=1)
        ]
    if found.edit is not None:
        change = {
            "artifactLocation": _location(found.edit.span.file),
            "replacements": [
                {
                    "deletedRegion": _region(found.edit.span),
                    "insertedContent": {"text": found.edit.text},
                }
            ],
        }
        description = {"text": found.help or found.message}
        result["fixes"] = [{"description": description, "artifactChanges": [change]}]
    return result


def _name(path: str) -> dict[str, str]:
    return {"fullyQualifiedName": path, "kind": "property"}


def _place(span: Span) -> dict[str, Any]:
    return {"physicalLocation": {"artifactLocation": _location(span.file), "region": _region(span)}}


def _region(span: Span) -> dict[str, int]:
    return {
        "startLine": span.line,
        "startColumn": span.column,
        "endLine": span.end_line,
        "endColumn": span.end_column,
    }


def _location(file: str) -> dict[str, str]:
    path = PurePosixPath(file)
    # A name need not be UTF-8; surrogates then stand for its bytes.
    try:
        encoded = quote(str(path).encode("utf-8", "surrogateescape"))
    except UnicodeEncodeError:  # of no byte: no file system gives such a name
        encoded = quote(str(path).encode("utf-8", "surrogatepass"))
    return {"uri": f"file://{encoded}" if path.is_absolute() else encoded}


def _fingerprint(found: Diagnostic, path: str) -> str:
    text = "\0".join((found.code, found.span.file, path, found.message))
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:32]
