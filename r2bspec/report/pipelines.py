"""The formats that pipelines read: JUnit XML, and the annotations of GitHub.

JUnit XML has a suite for the run, a case for each requirement, and one for the run itself. A failed
requirement is a failure and an inconclusive one an error, so that neither passes a pipeline; in the
format ``junit_lenient`` the latter is skipped. A requirement whose level is not ``error`` passes
with its verdict in the output. A run that is invalid or incomplete is an error of the case ``run``.

Workflow commands are what GitHub shows as annotations on the lines of the spec. A failed
requirement is an error, an inconclusive one a warning; both are placed on the line of the
requirement if the spec's file is known. GitHub keeps ten annotations of each kind and step, and
drops the rest without a message: a last line says how many were omitted.
"""

from __future__ import annotations

import datetime
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from r2bspec.compare.report_input import ReportInput
from r2bspec.diagnostics.diagnostic import Span
from r2bspec.diagnostics.quote import printable, printable_lines
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.language.load_spec import LoadedSpec, load_spec
from r2bspec.language.located_tree import ListNode, ScalarNode, lookup
from r2bspec.measure.units import at_rate, show
from r2bspec.report.finding_formats import command
from r2bspec.report.headline import headline, reason_after, requirement_headline
from r2bspec.report.notes import notes, particular_sentences, unplayed_notes
from r2bspec.report.report_wording import (
    bounds_text,
    code_text,
    comparison,
    estimate_text,
    outcome_title,
    requirement_text,
    several_monitors,
    verdict_word,
)
from r2bspec.untrusted.safe_file import is_regular

if TYPE_CHECKING:
    from junitparser import TestCase, TestSuite


def render_junit(report_input: ReportInput) -> bytes:
    """The XML, with inconclusive requirements as errors."""
    return to_xml(report_input, lenient=False)


def to_xml(report_input: ReportInput, *, lenient: bool) -> bytes:
    """The XML; with `lenient`, inconclusive requirements are skipped cases instead of errors."""
    from junitparser import JUnitXml

    suite = to_suite(report_input, lenient=lenient)
    xml = JUnitXml(suite.name)
    xml.add_testsuite(suite)
    xml.time = suite.time
    buffer = io.BytesIO()
    xml.write(buffer, pretty=True)
    return buffer.getvalue().rstrip() + b"\n"


def to_suite(report_input: ReportInput, *, lenient: bool) -> TestSuite:
    """The test suite of one run; see `to_xml`."""
    from junitparser import TestSuite

    result = report_input.result
    name = printable(result.name)
    suite = TestSuite(name)
    suite.timestamp = printable(result.started_at)
    suite.add_property("plan_hash", printable(result.plan_hash))
    suite.add_property("run_id", printable(result.run_id))
    if code := code_text(result):
        suite.add_property("code", printable(code))
    for key, value in result.labels.items():
        suite.add_property(printable(f"label.{key}"), printable(str(value)))
    suite.add_testcase(_run_case(report_input, name))
    for one in result.verdict.requirements:
        suite.add_testcase(_requirement_case(one, result, lenient=lenient))
    # After the cases: adding one makes the suite sum up the times of all.
    suite.time = _duration_s(result.started_at, result.ended_at)
    return suite


def _run_case(report_input: ReportInput, name: str) -> TestCase:
    """The test case of the run itself."""
    from junitparser import Error, TestCase

    verdict = report_input.result.verdict
    line = headline(report_input.result)
    case = TestCase("run", name)
    if verdict.outcome in {"invalid", "incomplete"}:
        error = Error(printable_lines(line), verdict.outcome)
        if "\n" in verdict.reason:
            # Once more: readers of XML turn the line breaks of an attribute into spaces.
            error.text = printable_lines(verdict.reason)
        case.result = [error]
    # The verdict of requirements does not say of how many starts it is.
    judged = not case.result and verdict.requirements
    texts = [line, reason_after(line, verdict)] if judged else []
    told = notes(report_input.result, verbose=report_input.verbose)
    texts = [*filter(None, texts), *comparison(report_input.result), *told.shown]
    texts += [told.more] if told.more else []
    if texts:
        case.system_out = "\n".join(map(printable_lines, texts))
    return case


def _requirement_case(one: RequirementVerdict, result: Result, *, lenient: bool) -> TestCase:
    from junitparser import Error, Failure, Skipped, TestCase

    name, several = printable(result.name), several_monitors(result.verdict)
    text = requirement_text(one, name_monitor=several)
    at = f" {at_rate(one.at_hz)}" if one.at_hz else ""
    case = TestCase(printable(f"{text}{at}"), printable(f"{name}.{one.objective}"))
    # The notes of all requirements are those of the run, among the output of its case.
    reason = printable_lines(" ".join(filter(None, (one.reason, one.settle))))
    if one.outcome == "pass" or one.level != "error":
        case.system_out = f"{verdict_word(one)}: {reason}\n{_numbers(one)}"
    else:
        kind = Failure if one.outcome == "fail" else Skipped if lenient else Error
        line = requirement_headline(one, result, name_monitor=several)
        found = kind(printable_lines(line), one.outcome)
        found.text = f"{reason}\n{_numbers(one)}"
        case.result = [found]
    return case


def _numbers(one: RequirementVerdict) -> str:
    limit = show(one.limit, one.unit) if one.limit is not None else "-"
    return (
        f"estimate {estimate_text(one)}, bounds {bounds_text(one) or '-'}, limit {limit}, "
        f"n {one.n}, {one.method}, confidence {one.confidence:g}"
    )


def _duration_s(started: str, ended: str) -> float:
    try:
        span = datetime.datetime.fromisoformat(ended) - datetime.datetime.fromisoformat(started)
    except ValueError:
        return 0.0
    return max(span.total_seconds(), 0.0)


def render_junit_lenient(report_input: ReportInput) -> bytes:
    """The XML; see `r2bspec.report.pipelines`."""
    return to_xml(report_input, lenient=True)


MAX_ANNOTATIONS = 9
"""Annotations of requirements; the verdict is the tenth."""

_COMMANDS = {"fail": "error", "inconclusive": "warning"}
_ADVISORY_COMMANDS = {"warn": "warning", "info": "notice"}
"""Of requirements that do not fail the run."""


def render_github(report_input: ReportInput) -> bytes:
    """The commands, the verdict first, failures before what is inconclusive."""
    return "".join(f"{line}\n" for line in _commands(report_input)).encode()


def _commands(report_input: ReportInput) -> Iterator[str]:
    verdict = report_input.result.verdict
    spec_file = report_input.spec_file
    # GitHub identifies files by their path in the repository, the working folder of a job.
    if spec_file is not None and spec_file.is_absolute() and spec_file.is_relative_to(Path.cwd()):
        spec_file = spec_file.relative_to(Path.cwd())
    locations = read_requirement_locations(spec_file)
    file = str(spec_file) if spec_file is not None else ""
    kind = {"pass": "notice", "inconclusive": "warning"}.get(verdict.outcome, "error")
    title = f"{report_input.result.name}: {outcome_title(verdict)}"
    line = headline(report_input.result)
    told = "\n".join(filter(None, (line, reason_after(line, verdict))))
    yield command(kind, title, told, {"file": file} if file else {})
    for one_input, text in zip(
        report_input.result.unplayed, unplayed_notes(report_input.result), strict=True
    ):
        shown = "warning" if one_input.is_warning else "notice"
        where = {"file": file} if file else {}
        yield command(shown, f"{report_input.result.name}: {one_input.topic}", text, where)
    several = several_monitors(verdict)
    annotated = [
        one for outcome in _COMMANDS for one in verdict.requirements if one.outcome == outcome
    ]
    annotated.sort(key=lambda one: one.level in _ADVISORY_COMMANDS)
    for one in annotated[:MAX_ANNOTATIONS]:
        text = requirement_text(one, name_monitor=several)
        at = f" {at_rate(one.at_hz)}" if one.at_hz else ""
        texts = "\n".join(particular_sentences(one))
        shown = _ADVISORY_COMMANDS.get(one.level, _COMMANDS[one.outcome])
        place = _place(one, locations, file)
        yield command(shown, f"{one.objective}: {text}{at}", texts, place)
    if len(annotated) > MAX_ANNOTATIONS:
        omitted = len(annotated) - MAX_ANNOTATIONS
        yield f"{omitted} more requirements are not annotated; see the report"


def _place(
    one: RequirementVerdict, locations: RequirementLocations | None, file: str
) -> dict[str, str]:
    if locations is None:
        return {"file": file} if file else {}
    span: Span = locations.find(one)
    # A value from an option has a location without a file.
    if not span.line or span.file != locations.loaded.file:
        return {"file": file}
    found = {"file": span.file, "line": str(span.line), "endLine": str(span.end_line)}
    if span.line == span.end_line:  # GitHub refuses columns of a span of several lines
        found |= {"col": str(span.column), "endColumn": str(span.end_column)}
    return found


@dataclass(frozen=True)
class RequirementLocations:
    """The locations of a spec's requirements."""

    loaded: LoadedSpec

    def find(self, one: RequirementVerdict) -> Span:
        """The location of a requirement; else of its objective; else the whole file."""
        path = ("slos", one.objective, "require")
        listed = lookup(self.loaded.tree, path) if self.loaded.tree is not None else None
        for item in listed.items if isinstance(listed, ListNode) else ():
            if isinstance(item, ScalarNode) and item.text.strip() == one.text.strip():
                return item.span
        return self.loaded.span(("slos", one.objective), key=True)


def read_requirement_locations(spec_file: Path | None) -> RequirementLocations | None:
    """The locations in a file; None if it is unknown, missing, or not a spec."""
    if spec_file is None or not is_regular(spec_file) or spec_file.suffix == ".json":
        return None
    loaded = load_spec(spec_file)
    return RequirementLocations(loaded) if loaded.tree is not None else None
