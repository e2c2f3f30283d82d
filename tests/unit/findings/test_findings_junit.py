"""Findings as JUnit XML: a suite for each file, a case for each family of rules."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.report.finding_formats import render
from r2bspec.report.findings_text import code_with_slug, slug_of


def found(code: str, severity: Severity, message: str = "wrong") -> Diagnostic:
    return Diagnostic(code, severity, message, Span("a.yaml", 3, 5, 3, 6), help="put it right")


def suites(*diagnostics: Diagnostic, files: tuple[str, ...] = ()) -> list[ET.Element]:
    return list(ET.fromstring(render("junit", diagnostics, {}, files)))  # noqa: S314


def test_a_file_without_findings_is_a_suite_that_passed() -> None:
    (suite,) = suites(files=("a.yaml",))
    assert suite.attrib["name"] == "a.yaml"
    assert (suite.attrib["tests"], suite.attrib["failures"]) == ("7", "0")


def test_errors_of_a_family_are_one_failure() -> None:
    one, two = found("R2B204", Severity.ERROR), found("R2B205", Severity.ERROR, "also")
    (suite,) = suites(one, two, files=("a.yaml",))
    (failure,) = suite.iter("failure")
    assert failure.attrib == {"message": f"{slug_of('R2B204')}: wrong", "type": "R2B204"}
    assert failure.text is not None
    assert failure.text.splitlines() == [
        f"a.yaml:3:5: error[{code_with_slug('R2B204')}]: wrong (put it right)",
        f"a.yaml:3:5: error[{code_with_slug('R2B205')}]: also (put it right)",
    ]


def test_warnings_fail_nothing_and_are_seen() -> None:
    (suite,) = suites(found("R2B512", Severity.WARNING))
    assert suite.attrib["failures"] == "0"
    (output,) = suite.iter("system-out")
    assert f"warning[{code_with_slug('R2B512')}]" in str(output.text)


def test_what_was_not_looked_at_is_skipped() -> None:
    (suite,) = suites(found("R2B101", Severity.ERROR))
    assert suite.attrib["skipped"] == "5"


def test_characters_that_xml_forbids_are_replaced() -> None:
    nasty = Diagnostic("R2B101", Severity.ERROR, "a\x00\x1b<&>", Span("f\x07", 1, 1, 1, 2))
    (suite,) = suites(nasty)
    assert suite.attrib["name"] == "f\ufffd"
