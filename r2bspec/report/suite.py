"""Several runs as one summary: text, Markdown, HTML, JUnit and JSON.

The table of a folder is that of a single spec, with a column for the spec.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, Literal

import msgspec

from r2bspec.compare.report_input import ReportInput
from r2bspec.diagnostics.plain_text import harmless
from r2bspec.diagnostics.quote import first_words, pluralize, printable, printable_lines
from r2bspec.errors import ExitStatus, R2bspecError, split_output
from r2bspec.judge.measure.distribution import SHORT_PERCENTILES, part_title, part_value
from r2bspec.judge.measure.units import show, show_rate
from r2bspec.judge.result import Result
from r2bspec.report import wording
from r2bspec.report.document import (
    Cell,
    Column,
    Document,
    Fold,
    Items,
    Row,
    Section,
    Table,
    Verbatim,
)
from r2bspec.report.finding_formats import junit_text
from r2bspec.report.notes import interference_text
from r2bspec.report.result_document import requirement_columns, requirement_rows
from r2bspec.report.write_reports import STDOUT, link_text

_SEVERITY: Final = (
    ExitStatus.OK,
    ExitStatus.INCONCLUSIVE,
    ExitStatus.RUN_FAILED,
    ExitStatus.FINDINGS_OR_FAILED,
    ExitStatus.USAGE,
    ExitStatus.INTERNAL_ERROR,
    ExitStatus.INTERRUPTED,
)
"""Exit statuses, the worst last: what a retry may mend is not as bad as what it cannot."""


class SuiteRun(msgspec.Struct, frozen=True, kw_only=True):
    """A run of a suite.

    Attributes:
        name: the name of the benchmark, with its case.
        folder: the run folder; empty where nothing was run.
        outcome: the outcome of the verdict; ``error`` where the run failed, ``skipped`` after a
            failure.
        resumed: whether the run is an earlier one.
        host: of a fleet, that made it; empty on this host.
        line: the first line of its reports; empty where it has no result.
        gate: what its comparison with a base is to be read with, a sentence each.
        report: its page in HTML; empty where it has none.
        revision: the revision of its code, with ``+dirty`` for changes that are not committed;
            empty where it is not known.
        base_revision: the base revision of the code that it was compared with; empty without a
            base.
    """

    name: str
    spec: str
    folder: str
    outcome: str
    reason: str
    exit_status: int
    resumed: bool = False
    host: str = ""
    line: str = ""
    gate: tuple[str, ...] = ()
    report: str = ""
    revision: str = ""
    base_revision: str = ""


class SuiteSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Runs that were made one after another, in their order.

    Attributes:
        exit_status: the worst of all; see `worst_status`.
        gate: what is gone from the specs of the base and allowed, a sentence each.
    """

    r2bspec_suite: Literal[1] = 1
    started_at: str
    ended_at: str
    machine: dict[str, str] = {}
    exit_status: int
    gate: tuple[str, ...] = ()
    runs: tuple[SuiteRun, ...]


def worst_status(statuses: Iterable[int]) -> ExitStatus:
    """Return the worst exit status; 0 for none."""
    by_number = {status.value: status for status in ExitStatus}
    worst = [by_number[status] for status in statuses]
    return max(worst, key=_severity, default=ExitStatus.OK)


def _severity(status: ExitStatus) -> int:
    return _SEVERITY.index(status) if status in _SEVERITY else len(_SEVERITY)


def run_with_result(
    result: Result,
    *,
    spec: str,
    folder: str,
    name: str = "",
    resumed: bool = False,
    host: str = "",
    report: str = "",
) -> SuiteRun:
    """Return a run that has a result."""
    revision, base_revision = wording.revisions(result)
    return SuiteRun(
        name=name or result.name,
        spec=spec,
        folder=folder,
        outcome=result.verdict.outcome,
        reason=result.verdict.reason,
        exit_status=result.verdict.exit_code,
        resumed=resumed,
        host=host,
        line=wording.headline(result),
        gate=result.gate,
        report=report,
        revision=revision,
        base_revision=base_revision,
    )


def run_with_error(
    error: R2bspecError,
    *,
    name: str,
    spec: str,
    folder: str = "",
    host: str = "",
    report: str = "",
) -> SuiteRun:
    """Return a run that failed, or a spec that could not be run."""
    return SuiteRun(
        name=name,
        spec=spec,
        folder=folder,
        outcome="error",
        reason=f"{error.code}: {error}" + (f". {error.hint}" if error.hint else ""),
        exit_status=error.exit_code,
        host=host,
        report=report,
    )


Results = Mapping[str, Result]
"""The results of the runs that have one, by run folder."""

SUITE_FORMATS: Final = ("text", "json", "markdown", "html", "junit")
"""The formats of a summary, by the names of the formats of a run."""

_WORDS: Final[dict[str, str]] = {
    **dict(wording.OUTCOME_WORDS.items()),
    "error": "✘ ERROR",
    "skipped": "– skipped",
}
_NAMED_RUNS: Final = 5
"""Runs that a sentence about several names; it counts the others."""

_WORST_FIRST: Final = ("error", "fail", "inconclusive", "pass", "")


def render(name: str, summary: SuiteSummary, results: Results, path: str = STDOUT) -> bytes:
    """Return a summary in a format of `SUITE_FORMATS`, for a file of this path."""
    if name == "json":
        return msgspec.json.format(msgspec.json.encode(summary), indent=2) + b"\n"
    told = _with_distinct_names(summary)
    if name == "junit":
        return harmless(_junit(told, summary.runs, results)).encode()
    document = suite_document(told, results, path)
    if name == "html":
        from r2bspec.report.html.page import to_page

        return harmless(to_page(document).decode()).encode()
    if name == "markdown":
        from r2bspec.report.markdown import to_markdown

        return harmless(to_markdown(document)).encode()
    from r2bspec.report.terminal import to_text

    return harmless(to_text(document, whole_tables=True)).encode()


def suite_document(summary: SuiteSummary, results: Results, path: str = STDOUT) -> Document:
    """Return the report of several runs, for a file of this path."""
    counts: dict[str, int] = {}
    for run in summary.runs:
        counts[run.outcome] = counts.get(run.outcome, 0) + 1
    number = pluralize(len(summary.runs), "run")
    parts = ", ".join(f"{count} {outcome}" for outcome, count in counts.items())
    verdicts = _verdict_table(summary, results, path)
    sentences = tuple(_sentences(summary, results))
    measured = _measurement_table(summary, results)
    return Document(
        line=f"{number}: {parts or 'nothing to run'}",
        sections=(
            *((Section("Verdicts", (verdicts,)),) if summary.runs else ()),
            *((Section("Notes", (Items(sentences),)),) if sentences else ()),
            *((Section("Output", tuple(_outputs(summary))),) if any(_outputs(summary)) else ()),
            *((Section("Measurements", (measured,), folded=True),) if measured.rows else ()),
        ),
        footer=f"{summary.started_at} to {summary.ended_at}",
    )


def _verdict_table(summary: SuiteSummary, results: Results, path: str) -> Table:
    """Return a row for each requirement of each run, the worst first."""
    judged = [result for run in summary.runs if (result := results.get(run.folder)) is not None]
    columns = requirement_columns(
        (one for result in judged for one in result.verdict.requirements), specs=True
    )
    rows: list[Row] = []
    for run in summary.runs:
        spec = _spec_cell(run, path)
        result = results.get(run.folder)
        own: list[Row] = []
        if result is not None and result.verdict.is_judged and run.outcome != "error":
            own = requirement_rows(result, columns, spec=spec)
        rows += own or [_bare_row(run, result, spec, len(columns))]
    rows.sort(key=lambda row: _WORST_FIRST.index(row.outcome))
    return Table("requirements", columns, tuple(rows))


def _spec_cell(run: SuiteRun, path: str) -> Cell:
    link = link_text(Path(run.report), path if path != STDOUT else "") if run.report else ""
    return Cell(_called(run), link=link, after="(earlier run)" if run.resumed else "")


def _bare_row(run: SuiteRun, result: Result | None, spec: Cell, columns: int) -> Row:
    """Return the row of a run without verdicts on requirements, with the reason."""
    word = _WORDS.get(run.outcome, run.outcome)
    if result is not None and run.outcome == result.verdict.outcome:
        word = wording.overall_word(result.verdict)
    outcome = {"skipped": "", "invalid": "error", "incomplete": "error"}.get(
        run.outcome, run.outcome
    )
    empty = (Cell(""),) * (columns - 2)
    reason, _ = split_output(run.reason)
    return Row((Cell(word), spec, *empty), (reason,) if outcome != "pass" else (), outcome)


def _outputs(summary: SuiteSummary) -> Iterator[Fold]:
    """Yield the last output of each process that ended a run."""
    for run in summary.runs:
        _, output = split_output(run.reason)
        if output:
            yield Fold(f"Last output of {_called(run)}", (Verbatim(output),))


def _measurement_table(summary: SuiteSummary, results: Results) -> Table:
    """Return what the monitors of each run received at each rate."""
    rows = []
    for run in summary.runs:
        result = results.get(run.folder)
        if result is None:
            continue
        search = result.metrics.search
        peak = Cell(show(search.holds_hz, "Hz") if search is not None else "")
        for rate in result.metrics.rates:
            for monitor, seen in rate.pooled.monitors.items():
                shown = (part_value(seen.latency, part) for part in SHORT_PERCENTILES)
                cells = (
                    *(Cell(_called(run)), Cell(monitor)),
                    Cell(show_rate(rate.offered_hz, rate.pace)),
                    Cell(show(seen.throughput_hz, "Hz")),
                    *(Cell(show(value, "s")) for value in shown),
                    peak,
                )
                rows.append(Row(cells))
        if search is not None and not result.metrics.rates:
            rows.append(Row((Cell(_called(run)), *(Cell(""),) * 5, peak)))
    titles = ("offered", "throughput", *map(part_title, SHORT_PERCENTILES), "peak")
    columns = (Column("spec", number=False), Column("monitor", number=False), *map(Column, titles))
    return Table("measurements", columns, tuple(rows))


def _sentences(summary: SuiteSummary, results: Results) -> Iterator[str]:
    """Yield what is said below the table: of open runs, the machine, the gate, and the code."""
    yield from (run.line for run in summary.runs if run.line and run.outcome != "pass")
    busy = [
        (_called(run), interference_text(result))
        for run in summary.runs
        if (result := results.get(run.folder)) is not None
        and any(wording.open_on_busy_machine(one, result) for one in result.verdict.requirements)
    ]
    if busy:
        names = ", ".join(name for name, _ in busy)
        text = next((text for _, text in busy if text), "other programs used it")
        yield f"The machine was busy in {names}: {text[:1].lower()}{text[1:]}"
    yield from (f"{text[:1].upper()}{text[1:]}" for text in summary.gate)
    names_of: dict[str, list[str]] = {}
    for run in summary.runs:
        for sentence in run.gate:
            names_of.setdefault(sentence, []).append(_called(run))
    yield from (
        f"{first_words(called, _NAMED_RUNS)}: {sentence}" for sentence, called in names_of.items()
    )
    yield from _revision_sentences(summary)


def _revision_sentences(summary: SuiteSummary) -> Iterator[str]:
    """Yield the code that was run: once for all runs, and by name if it is not the same of all."""
    names: dict[str, list[str]] = {}
    # A run without a base, such as that of a new spec, is no other if the head is the same.
    bases = {run.revision: run.base_revision for run in summary.runs if run.base_revision}
    for run in summary.runs:
        base = run.base_revision or bases.get(run.revision, "")
        if text := wording.revisions_text(run.revision, base):
            names.setdefault(text, []).append(_called(run))
    for text, called in names.items():
        whole = f"{text[:1].upper()}{text[1:]}"
        yield whole if len(names) == 1 else f"{first_words(called, _NAMED_RUNS)}: {text}"


def _junit(summary: SuiteSummary, known_runs: Sequence[SuiteRun], results: Results) -> str:
    """Return a test suite for each run, with a case for each requirement."""
    from junitparser import Error, JUnitXml, Skipped, TestCase, TestSuite

    from r2bspec.report.pipelines import to_suite

    xml = JUnitXml("r2bspec")
    for run, known in zip(summary.runs, known_runs, strict=True):
        if run.folder in results:
            suite = to_suite(ReportInput(result=results[run.folder]))
            if run.host or run.name != known.name:
                suite.name = printable(_called(run))
        else:
            suite = TestSuite(printable(_called(run)))
            case = TestCase("run", printable(_called(run)))
            kind = Skipped if run.outcome == "skipped" else Error
            case.result = [kind(printable_lines(run.reason), run.outcome)]
            suite.add_testcase(case)
        # Their names differ: not compared with each other, which is what adding them does.
        xml.append(suite)  # type: ignore[no-untyped-call]
    return junit_text(xml)


def _with_distinct_names(summary: SuiteSummary) -> SuiteSummary:
    """Return the summary with the path of the spec after each name that several specs have.

    Runs of one spec on several hosts are told apart by their hosts.
    """
    specs: dict[str, set[str]] = {}
    for run in summary.runs:
        specs.setdefault(run.name, set()).add(run.spec)
    runs = tuple(_with_path(run) if len(specs[run.name]) > 1 else run for run in summary.runs)
    return msgspec.structs.replace(summary, runs=runs)


def _with_path(run: SuiteRun) -> SuiteRun:
    name = f"{run.name} ({run.spec})"
    line = run.line.replace(f" {run.name}: ", f" {name}: ", 1)
    return msgspec.structs.replace(run, name=name, line=line)


def _called(run: SuiteRun) -> str:
    return f"{run.name} on {run.host}" if run.host else run.name
