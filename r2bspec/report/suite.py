"""Several runs as one summary, a row for each spec and rate: text, Markdown, HTML, JUnit, JSON."""

from __future__ import annotations

import datetime
import html
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, Literal

import msgspec

from r2bspec.compare.report_input import ReportInput
from r2bspec.diagnostics.plain_text import harmless
from r2bspec.diagnostics.quote import pluralize, printable, printable_lines
from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.judge.measure.distribution import SHORT_PERCENTILES, part_title
from r2bspec.judge.measure.units import show, show_rate
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.report.finding_formats import junit_text
from r2bspec.report.headline import headline
from r2bspec.report.notes import notes_of_an_open_run
from r2bspec.report.output import printed_text
from r2bspec.report.plain_page import number_class, plain_page, plain_table
from r2bspec.report.report_wording import OUTCOME_WORDS, revisions, revisions_text
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


_URGENCY: Final = ("pass", "inconclusive", "fail")
"""Outcomes of a requirement, the one that matters most last."""


class SuiteRow(msgspec.Struct, frozen=True, kw_only=True):
    """One monitor at one rate; times in seconds, None where there is no value.

    Attributes:
        offered_hz: 0 where the recording or the graph sets the rate; `pace` says which.
        peak_hz: of the search of the run, the same in each of its rows.
        ratio: to the base, of the metric `ratio_metric`: what decided, where several are required.
    """

    offered_hz: float
    pace: str
    monitor: str
    throughput_hz: float | None = None
    latency_p50_s: float | None = None
    latency_p99_s: float | None = None
    peak_hz: float | None = None
    ratio: float | None = None
    ratio_metric: str = ""


class SuiteRun(msgspec.Struct, frozen=True, kw_only=True):
    """One run of a suite.

    Attributes:
        name: of the benchmark, with its case.
        folder: the run folder; empty where nothing was run.
        outcome: of the verdict; ``error`` where the run failed, ``skipped`` after a failure.
        resumed: whether the run is an earlier one.
        host: of a fleet, that made it; empty on this host.
        line: the first line of its reports; empty where it has no result.
        gate: what its comparison with a base is to be read with, a sentence each.
        report: its page in HTML; empty where it has none.
        notes: the main ones on an inconclusive run; see `notes_of_an_open_run`.
        revision: of its code, with ``+dirty`` for changes that are not committed; empty where it
            is not known.
        base_revision: of the code that it was compared with; empty without a base.
    """

    name: str
    spec: str
    folder: str
    outcome: str
    reason: str
    exit_status: int
    resumed: bool = False
    host: str = ""
    rows: tuple[SuiteRow, ...] = ()
    line: str = ""
    gate: tuple[str, ...] = ()
    report: str = ""
    notes: tuple[str, ...] = ()
    revision: str = ""
    base_revision: str = ""


class SuiteSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Runs that were made one after the other, in their order.

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
    """The worst exit status; 0 for none."""
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
    """A run that has a result."""
    revision, base_revision = revisions(result)
    return SuiteRun(
        name=name or result.name,
        spec=spec,
        folder=folder,
        outcome=result.verdict.outcome,
        reason=result.verdict.reason,
        exit_status=result.verdict.exit_code,
        resumed=resumed,
        host=host,
        rows=tuple(_rows(result)),
        line=headline(result),
        gate=result.gate,
        report=report,
        notes=notes_of_an_open_run(result),
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
    """A run that failed, or a spec that could not be run."""
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


def failure_page(error: R2bspecError, spec: str, path: str) -> bytes:
    """The HTML page of a call that failed before it had a run."""
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    run = run_with_error(error, name=Path(spec).name, spec=spec)
    summary = SuiteSummary(started_at=now, ended_at=now, exit_status=error.exit_code, runs=(run,))
    return render("html", summary, {}, path)


def _decisive_ratio(result: Result, rate_hz: float, monitor: str) -> RequirementVerdict | None:
    """The ratio to a base at a rate that matters most: one that failed, or else is open."""
    ratios = [
        requirement
        for requirement in result.verdict.requirements
        if requirement.compared is not None
        and requirement.monitor in {monitor, None}
        and math.isclose(requirement.at_hz or 0.0, rate_hz)
    ]
    return max(ratios, key=lambda ratio: _URGENCY.index(ratio.outcome), default=None)


def _rows(result: Result) -> Iterator[SuiteRow]:
    search = result.metrics.search
    for rate in result.metrics.rates:
        for monitor, seen in rate.pooled.monitors.items():
            compared = _decisive_ratio(result, rate.offered_hz, monitor)
            yield SuiteRow(
                offered_hz=rate.offered_hz,
                pace=rate.pace,
                monitor=monitor,
                throughput_hz=seen.throughput_hz,
                latency_p50_s=seen.latency.p50,
                latency_p99_s=seen.latency.p99,
                peak_hz=search.holds_hz if search is not None else None,
                ratio=compared.estimate if compared is not None else None,
                ratio_metric=compared.metric if compared is not None else "",
            )
    if search is not None and not result.metrics.rates:
        yield SuiteRow(offered_hz=0.0, pace="search", monitor="", peak_hz=search.holds_hz)


Results = Mapping[str, Result]
"""The results of the runs that have one, by run folder."""

_HEADER: Final = (
    *("benchmark", "rate", "monitor", "throughput"),
    *map(part_title, SHORT_PERCENTILES),
    *("peak", "ratio to base", "verdict"),
)
_RATIO: Final = _HEADER.index("ratio to base")
_NUMBERS: Final = frozenset(_HEADER[3:7])
_WORDS: Final[dict[str, str]] = {
    **dict(OUTCOME_WORDS.items()),
    "error": "✘ ERROR",
    "skipped": "– skipped",
}
_WIDEST: Final = 1000


SUITE_FORMATS: Final = ("text", "json", "markdown", "html", "junit")
"""The formats of a summary, by the names of the formats of a run."""


def render(name: str, summary: SuiteSummary, results: Results, path: str = STDOUT) -> bytes:
    """A summary in one of the `SUITE_FORMATS`, for a file of this path, or for standard output."""
    if name == "json":
        return msgspec.json.format(msgspec.json.encode(summary), indent=2) + b"\n"
    told = _with_distinct_names(summary)
    if name == "html":
        text = plain_page(_count_text(told), _sections(told, path))
    elif name == "junit":
        text = _junit(told, summary.runs, results)
    else:
        text = _markdown(told) if name == "markdown" else _text(told)
    return harmless(text).encode()


def _text(summary: SuiteSummary) -> str:
    """The outcomes, a table, then the first line of the report of each run that did not pass."""
    from rich.text import Text

    from r2bspec.report.terminal_tables import table

    header = _header(summary)
    grid = table(header)
    for column, title in zip(grid.columns, header, strict=True):
        column.justify = "right" if title in _NUMBERS else "left"
    for _, cells in _table(summary):
        grid.add_row(*map(Text, cells))
    lines = [f"{_count_text(summary)}\n"]
    if summary.runs:
        lines += ["\n", printed_text(lambda page: page.print(grid), _WIDEST)]
    lines += [f"\n{text}\n" for text in _paragraphs(summary)]
    return "".join(lines)


def _markdown(summary: SuiteSummary) -> str:
    """The same for a comment or a step summary."""
    from r2bspec.report.markdown import escaped, table

    lines = [f"### {escaped(_count_text(summary))}", ""]
    if summary.runs:
        lines += table(
            _header(summary), [tuple(map(escaped, cells)) for _, cells in _table(summary)]
        )
    reasons = [f"- {escaped(text)}" for text in _paragraphs(summary)]
    return "\n".join([*lines, "", *reasons]).rstrip() + "\n"


def _sections(summary: SuiteSummary, path: str) -> Iterator[str]:
    """A page that links to the pages of the runs."""
    yield f"<header>\n<h1>{html.escape(_count_text(summary))}</h1>\n</header>\n<main>"
    rows = (
        f"<tr>{''.join(_html_cells(summary, cells, run, path))}</tr>"
        for run, cells in _table(summary)
    )
    yield plain_table("Table of runs", _header(summary), _NUMBERS, rows)
    for text in _paragraphs(summary):
        yield f"<p>{html.escape(printable_lines(text))}</p>"
    yield f"<p>{html.escape(summary.started_at)} to {html.escape(summary.ended_at)}</p>\n</main>"


def _html_cells(
    summary: SuiteSummary, cells: Sequence[str], run: SuiteRun, path: str
) -> Iterator[str]:
    """The cells of a line; the name of the run, in its first one, leads to its page."""
    for number, (title, cell) in enumerate(zip(_header(summary), cells, strict=True)):
        text = html.escape(printable(cell))
        if number == 0 and cell and run.report:
            link = html.escape(link_text(Path(run.report), path if path != STDOUT else ""))
            text = f'<a href="{link}">{text}</a>'
        yield f"<td{number_class(title, _NUMBERS)}>{text}</td>"


def _junit(summary: SuiteSummary, known_runs: Sequence[SuiteRun], results: Results) -> str:
    """A test suite for each run, with a case for each requirement."""
    from junitparser import Error, JUnitXml, Skipped, TestCase, TestSuite

    from r2bspec.report.pipelines import to_suite

    xml = JUnitXml("r2bspec")
    for run, known in zip(summary.runs, known_runs, strict=True):
        if run.folder in results:
            suite = to_suite(ReportInput(result=results[run.folder]), lenient=False)
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
    """The summary with the path of the spec after each name that several specs have.

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


def _has_hosts(summary: SuiteSummary) -> bool:
    return any(run.host for run in summary.runs)


def _has_ratios(summary: SuiteSummary) -> bool:
    return any(row.ratio is not None for run in summary.runs for row in run.rows)


def _header(summary: SuiteSummary) -> tuple[str, ...]:
    """The titles of the columns: hosts and ratios only where there are some."""
    return _chosen(_HEADER, ("host",), summary)


def _chosen(
    cells: tuple[str, ...], host: tuple[str, ...], summary: SuiteSummary
) -> tuple[str, ...]:
    """The cells of a line, with the host after the first, that this table has columns for."""
    if not _has_ratios(summary):
        cells = (*cells[:_RATIO], *cells[_RATIO + 1 :])
    return (cells[0], *(host if _has_hosts(summary) else ()), *cells[1:])


def _table(summary: SuiteSummary) -> Iterator[tuple[SuiteRun, tuple[str, ...]]]:
    """The lines of each run; its name and its outcome stand in the first."""
    for run in summary.runs:
        word = _WORDS.get(run.outcome, run.outcome) + (" (earlier run)" if run.resumed else "")
        lines = [_cells(row) for row in run.rows] or [("",) * (len(_HEADER) - 2)]
        for number, line in enumerate(lines):
            name, host, outcome = ("", "", "") if number else (run.name, run.host, word)
            yield run, _chosen((name, *line, outcome), (host,), summary)


def _cells(row: SuiteRow) -> tuple[str, ...]:
    return (
        "search" if row.pace == "search" else show_rate(row.offered_hz, row.pace),
        row.monitor,
        show(row.throughput_hz, "Hz"),
        *(show(getattr(row, f"latency_{part}_s"), "s") for part in SHORT_PERCENTILES),
        show(row.peak_hz, "Hz"),
        "" if row.ratio is None else f"{row.ratio_metric} {show(row.ratio, 'share')}",
    )


def _paragraphs(summary: SuiteSummary) -> Iterator[str]:
    """What is said below the table: of runs that did not pass, of the gate, and of the code.

    What the gate says of the comparison with a base is said once, with the runs it is about.
    """
    yield from (_told(run) for run in summary.runs if run.outcome not in {"pass", "skipped"})
    yield from (f"{text[:1].upper()}{text[1:]}" for text in summary.gate)
    names: dict[str, list[str]] = {}
    for run in summary.runs:
        for sentence in run.gate:
            names.setdefault(sentence, []).append(_called(run))
    yield from (f"{', '.join(called)}: {sentence}" for sentence, called in names.items())
    yield from _revision_sentences(summary)


def _revision_sentences(summary: SuiteSummary) -> Iterator[str]:
    """The code that was run: once for all runs, and by name for those of other revisions.

    A run without a base, such as that of a new spec, is no other if the head is the same.
    """
    names: dict[tuple[str, str], list[str]] = {}
    # Runs with a base come first: the others have only half of what is said of them.
    for run in sorted(summary.runs, key=lambda run: not run.base_revision):
        same = ((head, base) for head, base in names if head == run.revision)
        code = (run.revision, run.base_revision)
        if run.revision:
            known = code if run.base_revision else next(same, code)
            names.setdefault(known, []).append(_called(run))
    usual = max(names, key=lambda code: len(names[code]), default=None)
    for code, called in names.items():
        text = revisions_text(*code)
        if code == usual:
            yield f"{text[:1].upper()}{text[1:]}"
        else:
            yield f"{', '.join(called)}: {text}"


def _told(run: SuiteRun) -> str:
    """The first line of the report of a run with its main notes, or its error."""
    if run.line:
        line = f"{run.line} (on {run.host})" if run.host else run.line
        return ". ".join([line, *(note.rstrip(".") for note in run.notes)])
    return f"{_WORDS.get(run.outcome, run.outcome)} {_called(run)}: {run.reason}"


def _called(run: SuiteRun) -> str:
    return f"{run.name} on {run.host}" if run.host else run.name


def _count_text(summary: SuiteSummary) -> str:
    """How many runs had which outcome: ``3 runs: 2 pass, 1 fail``."""
    counts: dict[str, int] = {}
    for run in summary.runs:
        counts[run.outcome] = counts.get(run.outcome, 0) + 1
    parts = ", ".join(f"{count} {outcome}" for outcome, count in counts.items())
    return f"{pluralize(len(summary.runs), 'run')}: {parts or 'nothing to run'}"
