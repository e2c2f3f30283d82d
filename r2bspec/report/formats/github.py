"""Workflow commands that GitHub shows as annotations on the lines of the spec.

A failed requirement is an error, an inconclusive one a warning; both are placed on the line of the
requirement if the spec's file is known. GitHub keeps ten annotations of each kind and step, and
drops the rest without a message: a last line says how many were omitted.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from r2bspec.compare.report_input import ReportInput
from r2bspec.diagnostics.diagnostic import Span
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.measure.units import at_rate
from r2bspec.report.headline import headline, reason_after
from r2bspec.report.notes import particular_sentences, unplayed_notes
from r2bspec.report.report_wording import (
    outcome_title,
    requirement_text,
    several_monitors,
)
from r2bspec.report.requirement_locations import RequirementLocations, read_requirement_locations

MAX_ANNOTATIONS = 9
"""Annotations of requirements; the verdict is the tenth."""

_COMMANDS = {"fail": "error", "inconclusive": "warning"}
_ADVISORY_COMMANDS = {"warn": "warning", "info": "notice"}
"""Of requirements that do not fail the run."""


def render(report_input: ReportInput) -> bytes:
    """The commands, the verdict first, failures before what is inconclusive."""
    return "".join(f"{line}\n" for line in _lines(report_input)).encode()


def _lines(report_input: ReportInput) -> Iterator[str]:
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


def command(kind: str, title: str, text: str, place: dict[str, str]) -> str:
    """A workflow command, such as ``::warning title=..::..``."""
    properties = {**place, "title": title}
    shown = ",".join(f"{key}={_property(value)}" for key, value in properties.items())
    return f"::{kind} {shown}::{_data(text)}"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")
