"""Findings for programs: JSON, SARIF, JUnit XML and the annotations of GitHub.

JSON is one object: ``version`` (1), ``errors`` and ``warnings`` (counts) and ``findings``, each
with ``code``, ``slug``, ``severity``, ``certainty``, ``message``, ``help``, ``file``, ``line``,
``column``, ``end_line``, ``end_column`` (all counted from 1, the end past the last character),
``path`` (keys and list indices from the root), ``related`` places and ``edit``, a safe
replacement, or null.

SARIF 2.1.0 is what code-scanning services show at the lines of a change. Each code that occurs is a
rule with its page of `r2bspec docs`. Columns are counted in Unicode code points; relative file
names are relative to the working directory of `validate`. The fingerprint of a result consists of
its code, file, path and message, not of its line, so that it does not change when lines are
inserted above it.

JUnit XML has a suite, with a case for each file, which its errors fail, with their places and
messages. Warnings are in its output, and do not fail it, as they do not fail `validate`.

GitHub keeps ten annotations of each step and drops the rest silently. Errors therefore come first,
and a last line gives the number of findings without an annotation.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import quote

import msgspec

from r2bspec._version import __version__
from r2bspec.diagnostics import Diagnostic, Severity, Span, format_path
from r2bspec.diagnostics.code_pages import find_page
from r2bspec.diagnostics.quote import printable
from r2bspec.report.findings_text import code_with_slug, render_text, slug_of

if TYPE_CHECKING:
    from junitparser import JUnitXml, TestCase


FORMATS = {
    "text": "for people",
    "json": "for programs",
    "github": "annotations of a change on GitHub",
    "sarif": "SARIF 2.1.0 for code scanning",
    "junit": "JUnit XML for test reports",
}
"""Each format and its use."""

DOCUMENT_FORMATS = frozenset({"json", "sarif", "junit"})
"""Formats that are one document; nothing else may be printed to the same stream."""


MAX_ANNOTATIONS = 10
"""Annotations of a step that GitHub keeps."""


def render(
    name: str,
    diagnostics: Iterable[Diagnostic],
    sources: Mapping[str, str],
    files: Iterable[str] = (),
    *,
    colour: bool = False,
) -> str:
    """Return the findings in the format of that name.

    Args:
        name: one of `FORMATS`.
        diagnostics: the findings in their order.
        sources: the texts that they point into, by file name; only text needs them.
        files: every file that was checked, with findings or without.
        colour: whether text is coloured.
    """
    if name == "text":
        blocks = render_text(diagnostics, sources, colour=colour)
        return blocks + "\n" if blocks else ""
    return _RENDERERS[name](list(diagnostics), dict.fromkeys(files))


def _json(diagnostics: Sequence[Diagnostic], _files: Iterable[str]) -> str:
    counts = Counter(diagnostic.severity for diagnostic in diagnostics)
    report = {
        "version": 1,
        "errors": counts[Severity.ERROR],
        "warnings": counts[Severity.WARNING],
        "findings": [_json_finding(diagnostic) for diagnostic in diagnostics],
    }
    return json.dumps(report, indent=2) + "\n"


def _json_finding(found: Diagnostic) -> dict[str, Any]:
    return {
        "code": found.code,
        "slug": slug_of(found.code),
        "severity": found.severity.value,
        "certainty": found.certainty.value,
        "message": found.message,
        "help": found.help,
        **msgspec.to_builtins(found.span),
        "path": list(found.path),
        "related": [
            {"message": related.message, **msgspec.to_builtins(related.span)}
            for related in found.related
        ],
        "edit": {"text": found.edit.text, **msgspec.to_builtins(found.edit.span)}
        if found.edit
        else None,
    }


SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"
_LEVELS = {Severity.ERROR: "error", Severity.WARNING: "warning", Severity.INFO: "note"}


def _sarif(diagnostics: Sequence[Diagnostic], _files: Iterable[str]) -> str:
    """Return one SARIF log with one run."""
    codes = sorted({finding.code for finding in diagnostics})
    log = {
        "$schema": SCHEMA,
        "version": "2.1.0",
        "runs": [
            {
                "tool": {
                    "driver": {
                        "name": "r2bspec",
                        "semanticVersion": __version__,
                        "rules": [_sarif_rule(code) for code in codes],
                    }
                },
                "columnKind": "unicodeCodePoints",
                "results": [
                    _sarif_result(diagnostic, codes.index(diagnostic.code))
                    for diagnostic in diagnostics
                ],
            }
        ],
    }
    return json.dumps(log, indent=2) + "\n"


def _sarif_rule(code: str) -> dict[str, Any]:
    page = find_page(code)
    if page is None:
        return {"id": code}
    return {
        "id": code,
        "name": page.slug,
        "shortDescription": {"text": page.title},
        "fullDescription": {"text": page.why},
        "help": {"text": f"'r2bspec docs {code}' shows a failing and a passing example."},
        "defaultConfiguration": {"level": _LEVELS[page.severity]},
    }


def _sarif_result(found: Diagnostic, rule: int) -> dict[str, Any]:
    text = f"{found.message}; {found.help}" if found.help else found.message
    path = format_path(found.path)
    result: dict[str, Any] = {
        "ruleId": found.code,
        "ruleIndex": rule,
        "level": _LEVELS[found.severity],
        "message": {"text": text},
        "locations": [_place(found.span)],
        "partialFingerprints": {"codePathMessage/v1": _fingerprint(found, path)},
        "properties": {"certainty": found.certainty.value},
    }
    if found.related:
        result["relatedLocations"] = [
            _place(related.span) | {"id": number, "message": {"text": related.message}}
            for number, related in enumerate(found.related, start=1)
        ]
    return result


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


def _junit(diagnostics: Sequence[Diagnostic], files: Iterable[str]) -> str:
    from junitparser import JUnitXml, TestSuite

    by_file: dict[str, list[Diagnostic]] = {file: [] for file in files}
    for diagnostic in diagnostics:
        by_file.setdefault(diagnostic.span.file, []).append(diagnostic)
    suite = TestSuite("r2bspec validate")
    suite.add_testcases([_case(file, inside) for file, inside in by_file.items()])
    xml = JUnitXml(suite.name)
    xml.add_testsuite(suite)
    return junit_text(xml)


def junit_text(xml: JUnitXml) -> str:
    """Return a document of JUnit XML as text, with a newline at its end."""
    buffer = io.BytesIO()
    xml.write(buffer, pretty=True)
    return buffer.getvalue().decode().rstrip() + "\n"


def _case(file: str, inside: Sequence[Diagnostic]) -> TestCase:
    from junitparser import Failure, TestCase

    case = TestCase(printable(file), "r2bspec validate")
    errors = [finding for finding in inside if _is_error(finding)]
    if errors:
        failure = Failure(_message(errors[0]), errors[0].code)
        failure.text = "\n".join(map(_line, errors))
        case.result = [failure]
    if others := [_line(finding) for finding in inside if not _is_error(finding)]:
        case.system_out = "\n".join(others)
    return case


def _is_error(found: Diagnostic) -> bool:
    return found.severity is Severity.ERROR


def _message(found: Diagnostic) -> str:
    slug = slug_of(found.code)
    return printable(f"{slug}: {found.message}" if slug else found.message)


def _line(found: Diagnostic) -> str:
    span = found.span
    label = f"{found.severity.value}[{code_with_slug(found.code)}]"
    text = f"{span.file}:{span.line}:{span.column}: {label}: {found.message}"
    line = text + (f" ({found.help})" if found.help else "")
    return printable(line)


_COMMANDS = {Severity.ERROR: "error", Severity.WARNING: "warning", Severity.INFO: "notice"}
_ORDER = tuple(_COMMANDS)


def _github(diagnostics: Sequence[Diagnostic], _files: Iterable[str]) -> str:
    ordered = sorted(diagnostics, key=lambda found: _ORDER.index(found.severity))
    lines = [_annotation(finding) for finding in ordered[:MAX_ANNOTATIONS]]
    if len(ordered) > MAX_ANNOTATIONS:
        lines.append(
            f"{len(ordered) - MAX_ANNOTATIONS} more findings are not annotated; see the log"
        )
    return "".join(f"{line}\n" for line in lines)


def _annotation(found: Diagnostic) -> str:
    text = f"{found.message}\n{found.help}" if found.help else found.message
    title = code_with_slug(found.code)
    return command(_COMMANDS[found.severity], title, text, command_place(found.span))


def command_place(span: Span) -> dict[str, str]:
    """Return the properties of a workflow command that place it on the lines of a file."""
    place = {"file": span.file, "line": str(span.line), "endLine": str(span.end_line)}
    if span.end_line == span.line:  # GitHub refuses columns for a span of several lines
        place |= {"col": str(span.column), "endColumn": str(span.end_column)}
    return place


def command(kind: str, title: str, text: str, place: Mapping[str, str]) -> str:
    """Return a workflow command of GitHub, such as ``::warning title=..::..``."""
    properties = {**place, "title": title}
    shown = ",".join(f"{key}={_property(value)}" for key, value in properties.items())
    return f"::{kind} {shown}::{_data(text)}"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")


_RENDERERS: Final[Mapping[str, Callable[[Sequence[Diagnostic], Iterable[str]], str]]] = {
    "json": _json,
    "github": _github,
    "sarif": _sarif,
    "junit": _junit,
}
