"""The summary of several runs as text, Markdown, HTML, JUnit XML and JSON."""

from __future__ import annotations

import html
import importlib.resources
import importlib.util
import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, Protocol

import msgspec

from r2bspec.compare.report_input import ReportInput
from r2bspec.diagnostics.plain_text import harmless
from r2bspec.diagnostics.quote import printable, printable_lines
from r2bspec.judge.result import Result
from r2bspec.measure.distribution import SHORT_PERCENTILES, part_title
from r2bspec.measure.units import show, show_rate
from r2bspec.report.format_registry import HOST_CHARTS, load
from r2bspec.report.report_wording import OUTCOME_WORDS, revisions_text
from r2bspec.report.suite_summary import SuiteRow, SuiteRun, SuiteSummary
from r2bspec.report.write_reports import STDOUT, link_text

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


class SuiteRenderer(Protocol):
    """Renders a summary for a file of this path, or for standard output."""

    def __call__(self, summary: SuiteSummary, results: Results, path: str = STDOUT) -> bytes:
        """The content of the file."""


def to_json(summary: SuiteSummary, results: Results, path: str = STDOUT) -> bytes:  # noqa: ARG001
    """The summary as it is."""
    return msgspec.json.format(msgspec.json.encode(summary), indent=2) + b"\n"


def to_text(summary: SuiteSummary, results: Results, path: str = STDOUT) -> bytes:  # noqa: ARG001
    """The outcomes, a table, then the first line of the report of each run that did not pass."""
    from rich.text import Text

    from r2bspec.report.output import console
    from r2bspec.report.terminal_tables import table

    summary = _with_distinct_names(summary)
    buffer = io.StringIO()
    page = console(buffer, width=_WIDEST, color_system=None, legacy_windows=False)
    header = _header(summary)
    made = table(header)
    for column, title in zip(made.columns, header, strict=True):
        column.justify = "right" if title in _NUMBERS else "left"
    for cells in _table(summary):
        made.add_row(*map(Text, cells))
    page.print(made)
    lines = [f"{_count_text(summary)}\n"]
    if summary.runs:
        lines += ["\n", *(f"{line.rstrip()}\n" for line in buffer.getvalue().splitlines())]
    lines += [f"\n{_told(run)}\n" for run in _not_passed(summary)]
    lines += [f"\n{sentence}\n" for sentence in _sentences(summary)]
    return harmless("".join(lines)).encode()


def to_markdown(summary: SuiteSummary, results: Results, path: str = STDOUT) -> bytes:  # noqa: ARG001
    """The same for a comment or a step summary."""
    from r2bspec.report.markdown import escaped, table

    summary = _with_distinct_names(summary)
    lines = [f"### {escaped(_count_text(summary))}", ""]
    if summary.runs:
        lines += table(_header(summary), [tuple(map(escaped, cells)) for cells in _table(summary)])
    reasons = [f"- {escaped(_told(run))}" for run in _not_passed(summary)]
    reasons += [f"- {escaped(sentence)}" for sentence in _sentences(summary)]
    return harmless("\n".join([*lines, "", *reasons]).rstrip() + "\n").encode()


def to_html(summary: SuiteSummary, results: Results, path: str = STDOUT) -> bytes:
    """One page that links to the pages of the runs; runs on several hosts are drawn, too."""
    summary = _with_distinct_names(summary)
    rows = "\n".join(
        f"<tr>{''.join(_html_cells(summary, cells, run, path))}</tr>"
        for run in summary.runs
        for cells in _rows_of(run, summary)
    )
    header = "".join(
        f'<th scope="col"{_class_of(each)}>{html.escape(each)}</th>' for each in _header(summary)
    )
    paragraphs = [*map(_told, _not_passed(summary)), *_sentences(summary)]
    reasons = "\n".join(f"<p>{html.escape(printable_lines(text))}</p>" for text in paragraphs)
    title = html.escape(_count_text(summary))
    style = importlib.resources.files("r2bspec.report.html").joinpath("style.css")
    page = (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>\n{style.read_text('utf-8')}</style>\n</head>\n"
        f"<body>\n<header>\n<h1>{title}</h1>\n</header>\n<main>\n"
        '<div class="wide" tabindex="0" role="region" aria-label="Table of runs">\n'
        f"<table>\n<thead><tr>{header}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table>\n"
        f"</div>\n{reasons}\n{''.join(_figures(summary, results))}"
        f"<p>{html.escape(summary.started_at)} to {html.escape(summary.ended_at)}</p>\n"
        "</main>\n</body>\n</html>\n"
    )
    return harmless(page).encode()


def _figures(summary: SuiteSummary, results: Results) -> Iterator[str]:
    """The charts of benchmarks that ran on several hosts."""
    if not _has_hosts(summary):
        return
    if importlib.util.find_spec("matplotlib") is None:
        yield "<p>Hosts are drawn where r2bspec[report] is installed.</p>\n"
        return
    for chart in load(HOST_CHARTS)(summary, results):
        note = f'<p class="note">{html.escape(chart.note)}</p>\n' if chart.note else ""
        yield (
            f"<figure>\n<figcaption>{html.escape(chart.title)}</figcaption>\n{chart.svg}\n"
            f"{note}</figure>\n"
        )


def _html_cells(
    summary: SuiteSummary, cells: Sequence[str], run: SuiteRun, path: str
) -> Iterator[str]:
    """The cells of a line; the name of the run, in its first one, leads to its page."""
    for number, (title, cell) in enumerate(zip(_header(summary), cells, strict=True)):
        text = html.escape(printable(cell))
        if number == 0 and cell and run.report:
            link = html.escape(link_text(Path(run.report), path if path != STDOUT else ""))
            text = f'<a href="{link}">{text}</a>'
        yield f"<td{_class_of(title)}>{text}</td>"


def _class_of(title: str) -> str:
    return ' class="n"' if title in _NUMBERS else ""


def to_junit(summary: SuiteSummary, results: Results, path: str = STDOUT) -> bytes:  # noqa: ARG001
    """A test suite for each run, with a case for each requirement."""
    from junitparser import Error, JUnitXml, Skipped, TestCase, TestSuite

    from r2bspec.report.pipelines import to_suite

    xml = JUnitXml("r2bspec")
    for run, known in zip(_with_distinct_names(summary).runs, summary.runs, strict=True):
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
        xml.add_testsuite(suite)
    buffer = io.BytesIO()
    xml.write(buffer, pretty=True)
    return harmless(buffer.getvalue().decode().rstrip() + "\n").encode()


SUITE_FORMATS: Final[dict[str, SuiteRenderer]] = {
    "text": to_text,
    "json": to_json,
    "markdown": to_markdown,
    "html": to_html,
    "junit": to_junit,
}
"""The formats of a summary, by the names of the formats of a run."""


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


def _table(summary: SuiteSummary) -> Iterator[tuple[str, ...]]:
    for run in summary.runs:
        yield from _rows_of(run, summary)


def _rows_of(run: SuiteRun, summary: SuiteSummary) -> Iterator[tuple[str, ...]]:
    """The lines of one run; its name and its outcome stand in the first."""
    word = _WORDS.get(run.outcome, run.outcome) + (" (earlier run)" if run.resumed else "")
    if not run.rows:
        empty = ("",) * (len(_HEADER) - 2)
        yield _chosen((run.name, *empty, word), (run.host,), summary)
    for number, row in enumerate(run.rows):
        name, host, outcome = (run.name, run.host, word) if number == 0 else ("", "", "")
        yield _chosen((name, *_cells(row), outcome), (host,), summary)


def _cells(row: SuiteRow) -> tuple[str, ...]:
    return (
        "search" if row.pace == "search" else show_rate(row.offered_hz, row.pace),
        row.monitor,
        show(row.throughput_hz, "Hz"),
        *(show(getattr(row, f"latency_{part}_s"), "s") for part in SHORT_PERCENTILES),
        show(row.peak_hz, "Hz"),
        "" if row.ratio is None else f"{row.ratio_metric} {show(row.ratio, 'share')}",
    )


def _gate_sentences(summary: SuiteSummary) -> Sequence[str]:
    """What is said of the comparison with a base, each sentence once with the runs it is about."""
    names: dict[str, list[str]] = {}
    for run in summary.runs:
        for sentence in run.gate:
            names.setdefault(sentence, []).append(_called(run))
    of_runs = [f"{', '.join(called)}: {sentence}" for sentence, called in names.items()]
    return [*(f"{text[:1].upper()}{text[1:]}" for text in summary.gate), *of_runs]


def _sentences(summary: SuiteSummary) -> Sequence[str]:
    """What is said below the table, after the runs that did not pass."""
    return [*_gate_sentences(summary), *_revision_sentences(summary)]


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


def _not_passed(summary: SuiteSummary) -> Sequence[SuiteRun]:
    return [run for run in summary.runs if run.outcome not in {"pass", "skipped"}]


def _count_text(summary: SuiteSummary) -> str:
    """How many runs had which outcome: ``3 runs: 2 pass, 1 fail``."""
    counts: dict[str, int] = {}
    for run in summary.runs:
        counts[run.outcome] = counts.get(run.outcome, 0) + 1
    total = len(summary.runs)
    parts = ", ".join(f"{count} {outcome}" for outcome, count in counts.items())
    return f"{total} {'run' if total == 1 else 'runs'}: {parts or 'nothing to run'}"
