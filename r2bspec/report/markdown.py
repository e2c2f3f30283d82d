"""Markdown for a pull request or a step summary: the verdict visible, the rest folded.

GitHub rejects comments of more than 65,536 characters; the tables are cut, with a count of the
omitted rows, long before that.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.measure.distribution import MAIN_PERCENTILES
from r2bspec.judge.measure.metrics import RunMetrics
from r2bspec.judge.measure.units import show, show_rate
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import Verdict
from r2bspec.report import anatomy_table
from r2bspec.report import report_wording as wording
from r2bspec.report.headline import headline, reason_after
from r2bspec.report.notes import notes
from r2bspec.report.result_table import (
    HOP_COLUMNS,
    METRICS,
    hop_cells,
    measured,
    monitor_names,
    reasons,
    requirement_rows,
)

_MAX_ROWS = 60
"""The largest number of rows of a table."""

_COLUMNS = (
    "throughput.mean",
    *(f"latency.{part}" for part in (*MAIN_PERCENTILES, "max")),
    *("sent", "missed"),
)
"""The metrics of the table of a monitor."""


def render(report_input: ReportInput) -> bytes:
    """The report: CommonMark with the tables and folding of GitHub and GitLab."""
    text = "\n".join(_lines(report_input))
    # GitLab carries out a line of a comment that begins with a slash, such as "/merge".
    return re.sub(r"(?m)^/", r"\/", text).encode()


def _lines(report_input: ReportInput) -> Iterator[str]:
    result = report_input.result
    verdict = result.verdict
    line = headline(result)
    yield f"### {escaped(line)}"
    yield ""
    if reason := reason_after(line, verdict):
        yield escaped(reason)
        yield ""
    if result.title and result.title != result.name:
        yield escaped(result.title)
        yield ""
    if facts := [*filter(None, (wording.loaded_rmw(result), wording.code_text(result)))]:
        yield " · ".join(map(code, facts))
        yield ""
    if compared := [*wording.comparison(result)]:
        yield from (f"{escaped(output_line)}  " for output_line in compared)
        yield ""
    if verdict.requirements:
        verbose = report_input.verbose
        yield from _requirements(verdict, wording.own_pace(result.metrics), verbose=verbose)
    told = notes(result, verbose=report_input.verbose)
    yield from (f"> {escaped(note)}  " for note in (*told.shown, told.more) if note)
    yield ""
    yield from folded("Measurements", _measured(result, told.shown))
    yield from folded("Anatomy", _anatomy(result))
    yield from folded("Environment", _provenance(report_input))


def _bounds_heading(verdict: Verdict) -> str:
    """The heading of the bounds, with their confidence if it is the same for all."""
    confidences = {requirement.confidence for requirement in verdict.requirements}
    return f"{show(confidences.pop(), 'share', 4)} bounds" if len(confidences) == 1 else "bounds"


def _requirements(verdict: Verdict, pace: str, *, verbose: bool) -> Iterator[str]:
    rows = requirement_rows(verdict, worst_first=True)
    yield from table(
        ("verdict", "requirement", "at", "estimate", _bounds_heading(verdict), "limit"),
        [
            (
                row.word,
                f"{escaped(row.verdict.objective)}: {code(row.text)}",
                show_rate(row.verdict.at_hz, pace) if row.verdict.at_hz is not None else "",
                escaped(row.estimate),
                escaped(row.bounds),
                row.limit,
            )
            for row in rows
        ],
    )
    # The table does not show the values behind a ratio that passes.
    explained = [
        row
        for row in rows
        if verbose or row.verdict.outcome != "pass" or row.verdict.compared is not None
    ][:_MAX_ROWS]
    for row, texts in zip(explained, reasons(explained), strict=True):
        name = f"- **{escaped(row.verdict.objective)}** {code(row.text)}"
        yield f"{name}: {' '.join(map(escaped, texts))}"
    yield ""


def _measured(result: Result, said: Collection[str]) -> Iterator[str]:
    metrics = result.metrics
    for name in monitor_names(metrics):
        yield f"**{escaped(result.monitor_title(name))}**"
        yield ""
        yield from table(
            ("offered", *(METRICS[metric].title for metric in _COLUMNS)),
            [
                (row.offered, *(row.text(metric) for metric in _COLUMNS))
                for row in measured(metrics, name)
            ],
        )
        yield from _hops(metrics, name)
    if metrics.search is not None and metrics.search.probes:
        yield f"Peak {escaped(wording.peak_text(metrics.search))}"
        yield ""
    for text in wording.overhead_notes(result):
        if text not in said:
            yield escaped(text)
            yield ""


def _hops(metrics: RunMetrics, monitor: str) -> Iterator[str]:
    """The latency of the hops to a monitor; nothing where it is not tapped."""
    rows = [
        (row.offered, *map(escaped, hop_cells(hop)))
        for row in measured(metrics, monitor)
        for hop in row.seen.hops
    ]
    if rows:
        yield f"Hops to **{escaped(monitor)}**"
        yield ""
        yield from table(("offered", *HOP_COLUMNS), rows)


def _anatomy(result: Result) -> Iterator[str]:
    """Where the messages of an iteration spent their time; nothing if none was observed."""
    for anatomy in anatomy_table.anatomies_of(result):
        for path in anatomy.paths:
            yield f"**{escaped(anatomy_table.title(anatomy, path))}**  "
            yield escaped(anatomy_table.caption(path))
            yield ""
            rows = [[*map(escaped, row)] for row in anatomy_table.part_rows(path)]
            yield from table(anatomy_table.PART_COLUMNS, rows)
        rows = [[*map(escaped, row)] for row in anatomy_table.node_rows(anatomy)]
        if rows:
            yield f"Nodes: {escaped(anatomy_table.NODES_CAPTION)}"
            yield ""
            yield from table(anatomy_table.NODE_COLUMNS, rows)
        yield from (f"{escaped(note)}  " for note in anatomy_table.anatomy_notes(anatomy))
        yield ""


def _provenance(report_input: ReportInput) -> Iterator[str]:
    result = report_input.result
    facts = {
        "run": result.run_id,
        "started": result.started_at,
        "plan": result.plan_hash,
        "starts": wording.starts_text(result.starts),
        **{f"dataset {key}": value for key, value in result.dataset.items()},
        **{f"machine {key}": value for key, value in result.machine.items()},
        **{f"version of {key}": value for key, value in result.versions.items()},
        **wording.code_facts(result),
    }
    yield from table(
        ("what", "value"),
        [(escaped(str(key)), escaped(str(value))) for key, value in facts.items() if value != ""],
    )


def folded(title: str, lines: Iterable[str]) -> Iterator[str]:
    """Lines folded below a title; nothing if there are none."""
    content = [*lines]
    if content:
        yield from (f"<details><summary>{escaped(title)}</summary>", "", *content)
        yield from ("</details>", "")


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """A table; its cells are Markdown already."""
    yield f"| {' | '.join(header)} |"
    yield f"| {' | '.join('---' for _ in header)} |"
    yield from (f"| {' | '.join(row)} |" for row in rows[:_MAX_ROWS])
    yield ""
    if len(rows) > _MAX_ROWS:
        yield f"{len(rows) - _MAX_ROWS} more rows are not shown."
        yield ""


def escaped(text: str) -> str:
    """Text shown literally by Markdown: no markup, no links, no mentions, on one line."""
    line = " ".join(text.split())
    line = line.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    line = re.sub(r"([\\`*_\[\]|~#$])", r"\\\1", line)
    # Entities keep '@name' from being a mention, and 'http://' from being a link.
    return line.replace("@", "&#64;").replace("://", "&#58;//")


def code(text: str) -> str:
    """Text in a code span, fit for the cell of a table."""
    line = " ".join(text.split()).replace("|", "\\|")
    longest = max((len(run) for run in re.findall(r"`+", line)), default=0)
    fence = "`" * (longest + 1)
    pad = " " if longest else ""
    return f"{fence}{pad}{line}{pad}{fence}"
