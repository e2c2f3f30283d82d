"""Findings as JUnit XML: a suite for each file, a case for each family of codes.

A case with errors has a failure that lists them with place and message. Warnings are in its output
and do not fail it, as they do not fail `validate`. A family without findings is a case that passed,
or that was skipped because the document itself has errors.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from r2bspec.diagnostics import Diagnostic, Severity
from r2bspec.diagnostics.code_pages import FAMILIES
from r2bspec.diagnostics.quote import printable
from r2bspec.report.findings.slugs import code_with_slug, slug_of

if TYPE_CHECKING:
    from junitparser import TestCase


_DOCUMENT_FAMILIES = frozenset("01")
"""Families whose errors prevent the rules of the other families from being applied."""

_OPTIONAL_FAMILIES = frozenset("7")
"""Families that only other verbs than `validate` check."""


def render(
    diagnostics: Iterable[Diagnostic], sources: Mapping[str, str], files: Iterable[str] = ()
) -> str:
    """The findings as one XML document; `files` are all files that were checked."""
    from junitparser import JUnitXml, TestSuite

    del sources
    by_file: dict[str, list[Diagnostic]] = {file: [] for file in files}
    for found in diagnostics:
        by_file.setdefault(found.span.file, []).append(found)
    xml = JUnitXml("r2bspec validate")
    for file, inside in by_file.items():
        suite = TestSuite(printable(file))
        unusable = any(_is_error(one) and one.code[3] in _DOCUMENT_FAMILIES for one in inside)
        for family, title in FAMILIES.items():
            own = [one for one in inside if one.code[3] == family]
            if not own and family in _OPTIONAL_FAMILIES:
                continue
            was_checked = not unusable or family in _DOCUMENT_FAMILIES
            suite.add_testcase(_case(f"R2B{family}xx {title}", file, own, was_checked=was_checked))
        xml.add_testsuite(suite)
    buffer = io.BytesIO()
    xml.write(buffer, pretty=True)
    return buffer.getvalue().decode().rstrip() + "\n"


def _case(name: str, file: str, inside: list[Diagnostic], *, was_checked: bool) -> TestCase:
    from junitparser import Failure, Skipped, TestCase

    case = TestCase(name, printable(file))
    errors = [one for one in inside if _is_error(one)]
    if not was_checked and not inside:
        case.result = [Skipped("not checked: the document itself has errors")]
    if errors:
        failure = Failure(_message(errors[0]), errors[0].code)
        failure.text = "\n".join(_line(one) for one in errors)
        case.result = [failure]
    others = [_line(one) for one in inside if not _is_error(one)]
    if others:
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
