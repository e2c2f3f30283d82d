"""JUnit XML: a suite for the run, a case for each requirement, and one for the run itself.

A failed requirement is a failure and an inconclusive one an error, so that neither passes a
pipeline; in `junit_lenient` the latter is skipped. A requirement whose level is not ``error``
passes with its verdict in the output. A run that is invalid or incomplete is an error of the case
``run``.
"""

from __future__ import annotations

import datetime
import io
from typing import TYPE_CHECKING

from r2bspec.compare.report_input import ReportInput
from r2bspec.diagnostics.quote import printable, printable_lines
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.measure.units import at_rate, show
from r2bspec.report.headline import headline, reason_after, requirement_headline
from r2bspec.report.notes import notes
from r2bspec.report.report_wording import (
    bounds_text,
    code_text,
    comparison,
    estimate_text,
    requirement_text,
    several_monitors,
    verdict_word,
)

if TYPE_CHECKING:
    from junitparser import TestCase, TestSuite


def render(report_input: ReportInput) -> bytes:
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
        suite.add_testcase(_case(one, result, lenient=lenient))
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


def _case(one: RequirementVerdict, result: Result, *, lenient: bool) -> TestCase:
    from junitparser import Error, Failure, Skipped, TestCase

    name, several = printable(result.name), several_monitors(result.verdict)
    text = requirement_text(one, name_monitor=several)
    at = f" {at_rate(one.at_hz)}" if one.at_hz else ""
    case = TestCase(printable(f"{text}{at}"), printable(f"{name}.{one.objective}"))
    # The notes of all requirements are those of the run, among the output of its case.
    reason = printable_lines(" ".join(filter(None, (one.reason, one.remedy))))
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
