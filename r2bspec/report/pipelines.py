"""The formats that pipelines read: JUnit XML, and the annotations of GitHub.

JUnit XML has a suite for the run, a case for each requirement, and a case for the run itself. A
failed requirement is a failure and an inconclusive requirement an error, so that neither passes a
pipeline. A requirement whose level is not ``error`` passes with its verdict in the output. A run
that is invalid or incomplete is an error of the case ``run``.

Workflow commands are what GitHub shows as annotations on the lines of the spec. A failed
requirement is an error, an inconclusive one a warning; both are placed on the line of the
requirement if the spec's file is known. GitHub keeps ten annotations of each kind and step, and
drops the rest without a message: a last line says how many were omitted.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from r2bspec.compare.report_input import ReportInput
from r2bspec.diagnostics.diagnostic import Span
from r2bspec.diagnostics.quote import printable, printable_lines
from r2bspec.judge.measure.units import at_rate, show
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.language.load_spec import LoadedSpec, load_spec
from r2bspec.language.located_tree import ListNode, ScalarNode, lookup
from r2bspec.report import wording
from r2bspec.report.finding_formats import command, command_place, junit_text
from r2bspec.report.notes import notes
from r2bspec.safe_io.safe_file import is_regular

if TYPE_CHECKING:
    from junitparser import TestCase, TestSuite


def render_junit(report_input: ReportInput) -> bytes:
    """Return the XML."""
    from junitparser import JUnitXml

    suite = to_suite(report_input)
    xml = JUnitXml(suite.name)
    xml.add_testsuite(suite)
    xml.time = suite.time
    return junit_text(xml).encode()


def to_suite(report_input: ReportInput) -> TestSuite:
    """Return the test suite of one run; see `render_junit`."""
    from junitparser import TestSuite

    result = report_input.result
    name = printable(result.name)
    suite = TestSuite(name)
    suite.timestamp = printable(result.started_at)
    suite.add_property("plan_hash", printable(result.plan_hash))
    suite.add_property("run_id", printable(result.run_id))
    if code := wording.code_text(result):
        suite.add_property("code", printable(code))
    for key, value in result.labels.items():
        suite.add_property(printable(f"label.{key}"), printable(str(value)))
    case_of = partial(_requirement_case, result=result)
    # All at once: each call counts the cases anew.
    suite.add_testcases(
        [
            _run_case(report_input, name),
            *map(case_of, result.verdict.requirements),
        ]
    )
    # After the cases: adding them makes the suite sum up the times of all.
    suite.time = _duration_s(result.started_at, result.ended_at)
    return suite


def _run_case(report_input: ReportInput, name: str) -> TestCase:
    """Return the test case of the run itself."""
    from junitparser import Error, TestCase

    verdict = report_input.result.verdict
    line = wording.headline(report_input.result)
    case = TestCase("run", name)
    if verdict.outcome in {"invalid", "incomplete"}:
        error = Error(printable_lines(line), verdict.outcome)
        if "\n" in verdict.reason:
            # Once more: readers of XML turn the line breaks of an attribute into spaces.
            error.text = printable_lines(verdict.reason)
        case.result = [error]
    # The verdict of requirements does not say of how many starts it is.
    judged = not case.result and verdict.requirements
    texts = [line, wording.reason_after(line, verdict)] if judged else []
    told = notes(report_input.result, verbose=report_input.verbose)
    texts = [*filter(None, texts), *wording.comparison(report_input.result), *told]
    if texts:
        case.system_out = "\n".join(map(printable_lines, texts))
    return case


def _requirement_case(verdict: RequirementVerdict, result: Result) -> TestCase:
    from junitparser import Error, Failure, TestCase

    title = _title(verdict, result)
    case = TestCase(printable(title), printable(f"{result.name}.{verdict.objective}"))
    # The notes of all requirements are those of the run, among the output of its case.
    reason = printable_lines(" ".join(filter(None, (verdict.reason, verdict.remedy))))
    numbers = (
        f"estimate {wording.estimate_text(verdict)} {wording.bounds_text(verdict)}, "
        f"limit {show(verdict.limit, verdict.unit)}, "
        f"n {verdict.n}, {verdict.method}, confidence {verdict.confidence:g}"
    )
    if verdict.outcome == "pass" or verdict.level != "error" or verdict.left_open:
        case.system_out = f"{wording.verdict_word(verdict)}: {reason}\n{numbers}"
    else:
        kind = Failure if verdict.outcome == "fail" else Error
        several = wording.several_monitors(result.verdict)
        line = wording.requirement_headline(verdict, result, name_monitor=several)
        problem = kind(printable_lines(line), verdict.outcome)
        problem.text = f"{reason}\n{numbers}"
        case.result = [problem]
    return case


def _title(verdict: RequirementVerdict, result: Result) -> str:
    """Return the requirement with its rate, where one was offered."""
    several = wording.several_monitors(result.verdict)
    text = wording.requirement_text(verdict, name_monitor=several)
    return f"{text} {at_rate(verdict.at_hz)}" if verdict.at_hz else text


def _duration_s(started: str, ended: str) -> float:
    try:
        span = datetime.datetime.fromisoformat(ended) - datetime.datetime.fromisoformat(started)
    except ValueError:
        return 0.0
    return max(span.total_seconds(), 0.0)


MAX_ANNOTATIONS = 9
"""Annotations of requirements; the verdict is the tenth."""

_COMMANDS = {"fail": "error", "inconclusive": "warning"}
_ADVISORY_COMMANDS = {"warn": "warning", "info": "notice"}
"""Of requirements that do not fail the run."""


def render_github(report_input: ReportInput) -> bytes:
    """Return the commands: the verdict first, failures before inconclusive requirements."""
    return "".join(f"{line}\n" for line in _commands(report_input)).encode()


def _commands(report_input: ReportInput) -> Iterator[str]:
    verdict = report_input.result.verdict
    spec_file = report_input.spec_file
    # GitHub identifies files by their path in the repository, the working folder of a job.
    if spec_file is not None and spec_file.is_absolute() and spec_file.is_relative_to(Path.cwd()):
        spec_file = spec_file.relative_to(Path.cwd())
    loaded = _locations(spec_file)
    file = str(spec_file) if spec_file is not None else ""
    kind = {"pass": "notice", "inconclusive": "warning"}.get(verdict.outcome, "error")
    title = f"{report_input.result.name}: {wording.outcome_title(verdict)}"
    line = wording.headline(report_input.result)
    told = "\n".join(filter(None, (line, wording.reason_after(line, verdict))))
    whole = {"file": file} if file else {}
    yield command(kind, title, told, whole)
    annotated = [
        one for outcome in _COMMANDS for one in verdict.requirements if one.outcome == outcome
    ]
    annotated.sort(key=lambda one: one.level in _ADVISORY_COMMANDS)
    for requirement in annotated[:MAX_ANNOTATIONS]:
        texts = "\n".join(wording.sentences(requirement))
        kind = _ADVISORY_COMMANDS.get(requirement.level, _COMMANDS[requirement.outcome])
        place = _place(requirement, loaded, whole)
        title = f"{requirement.objective}: {_title(requirement, report_input.result)}"
        yield command(kind, title, texts, place)
    if len(annotated) > MAX_ANNOTATIONS:
        omitted = len(annotated) - MAX_ANNOTATIONS
        yield f"{omitted} more requirements are not annotated; see the report"


def _place(
    requirement: RequirementVerdict, loaded: LoadedSpec | None, whole: dict[str, str]
) -> dict[str, str]:
    """Return the lines of a requirement, or the whole file."""
    if loaded is None:
        return whole
    span = _location(loaded, requirement)
    # A value from an option has a location without a file.
    return command_place(span) if span.line and span.file == loaded.file else whole


def _locations(spec_file: Path | None) -> LoadedSpec | None:
    """Return the spec that has the lines of requirements.

    None if it is unknown, missing, or no spec.
    """
    if spec_file is None or not is_regular(spec_file) or spec_file.suffix == ".json":
        return None
    loaded = load_spec(spec_file)
    return loaded if loaded.tree is not None else None


def _location(loaded: LoadedSpec, requirement: RequirementVerdict) -> Span:
    """Return the location of a requirement; else of its objective; else the whole file."""
    path = ("slos", requirement.objective, "require")
    listed = lookup(loaded.tree, path) if loaded.tree is not None else None
    for item in listed.items if isinstance(listed, ListNode) else ():
        if isinstance(item, ScalarNode) and item.text.strip() == requirement.text.strip():
            return item.span
    return loaded.span(("slos", requirement.objective), key=True)
