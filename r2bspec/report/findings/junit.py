"""Findings as JUnit XML: a suite for each file, a case for each family of rules.

A case with errors has a failure that lists them, each as its place and message; warnings are in
its output and fail nothing, as they do not fail validate. A family without findings is a case
that passed, or was skipped because the document itself is not right.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from r2bspec.diagnostics import Diagnostic, Severity
from r2bspec.diagnostics.code_pages import FAMILIES
from r2bspec.diagnostics.quote import printable

if TYPE_CHECKING:
    from junitparser import TestCase


_DOCUMENT_FAMILIES = frozenset("01")
"""Families whose errors leave no spec to which the rules of the others could be applied."""


def render(
    diagnostics: Iterable[Diagnostic], sources: Mapping[str, str], files: Iterable[str] = ()
) -> str:
    """The findings as one XML document; `files` names every file that was looked at."""
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
        case.result = [Skipped("the document itself must be right first")]
    if errors:
        failure = Failure(printable(errors[0].message), errors[0].code)
        failure.text = "\n".join(_line(one) for one in errors)
        case.result = [failure]
    others = [_line(one) for one in inside if not _is_error(one)]
    if others:
        case.system_out = "\n".join(others)
    return case


def _is_error(found: Diagnostic) -> bool:
    return found.severity is Severity.ERROR


def _line(found: Diagnostic) -> str:
    span = found.span
    text = f"{span.file}:{span.line}:{span.column}: {found.severity.value}[{found.code}]"
    line = f"{text}: {found.message}" + (f" ({found.help})" if found.help else "")
    return printable(line)
