"""From a result to the page: the context of its template, its charts, and its linked numbers."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any

import msgspec

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.measure.distribution import (
    MAIN_PERCENTILES,
    PARTS,
    SHORT_PERCENTILES,
    TAIL_PERCENTILE,
    part_title,
    part_value,
)
from r2bspec.judge.measure.units import show, show_rate
from r2bspec.judge.result import Result
from r2bspec.plan.plan import Plan
from r2bspec.report import anatomy_table, result_table
from r2bspec.report.anatomy_table import anatomies_of
from r2bspec.report.headline import headline, reason_after
from r2bspec.report.html.chart import Chart
from r2bspec.report.html.graph_drawing import lay_out
from r2bspec.report.html.latency_charts import has_latencies, messages_chart, percentile_chart
from r2bspec.report.html.load_charts import load_curve_chart, loads_chart
from r2bspec.report.html.templates import own_style, own_text, render_template
from r2bspec.report.html.waterfall import waterfalls
from r2bspec.report.notes import notes, profile_notes

if TYPE_CHECKING:
    from markupsafe import Markup


_GRAPH_WIDTH = 990
"""Pixels: what a figure of the page is wide, where the window has the room."""


def _number(result: Any, path: str, unit: str) -> Markup:
    """A value of the result as ``<data value="0.0123" data-path="…">12.3 ms</data>``; or a dash.

    The exact value is in the markup of the rounded text, so that a program, or a test, can read the
    page and compare it with the file.

    Args:
        result: as plain values.
        path: of the value, a JSON pointer without its first slash.
        unit: of the value.

    Raises:
        KeyError: the result has no such place.
    """
    from markupsafe import Markup, escape

    value = result
    for part in path.split("/"):
        value = (
            value[int(part)]
            if isinstance(value, list | tuple)
            else value[part.replace("~1", "/").replace("~0", "~")]
        )
    if value is None:
        return Markup("-")
    # Not by Markup.format, which takes six times as long: a page has tens of thousands.
    exact, place, shown = map(escape, (repr(value), path, show(float(value), unit)))
    return Markup(f'<data value="{exact}" data-path="{place}">{shown}</data>')  # noqa: S704


_LATENCY_COLUMNS = (
    *(f"latency.{part}" for part in PARTS),
    *(f"{family}.{TAIL_PERCENTILE}" for family in ("jitter", "latency_from_due")),
)
_THROUGHPUT_COLUMNS = (
    *("throughput.mean", "sent", "answered", "missed", "drop_rate"),
    *("late", "duplicates", "reordered", "unmatched", "overdue"),
)
_ITERATION_COLUMNS = (
    "throughput.mean",
    *(f"latency.{part}" for part in (*SHORT_PERCENTILES, "max")),
    *("sent", "missed"),
)
"""The metrics of the tables of a monitor."""

_MAX_SHOWN_ITERATIONS = 200
_MAX_SHOWN_REQUIREMENTS = 2_000
"""The most rows of a table; the worst requirements come first."""

_MAX_SHOWN_RATES = 4
"""Rates whose numbers are written into the drawing of the graph."""


def render(report_input: ReportInput) -> bytes:
    """The page, UTF-8. The same run gives the same bytes."""
    return render_template("page.html.j2", _context(report_input))


def _context(report_input: ReportInput) -> dict[str, Any]:
    result = report_input.result
    metrics = result.metrics
    ordered = result_table.requirement_rows(result.verdict, worst_first=True)
    shown = ordered[:_MAX_SHOWN_REQUIREMENTS]
    monitors = result_table.monitor_names(metrics)
    processes = [*dict.fromkeys(name for rate in metrics.rates for name in rate.pooled.processes)]
    charts = _charts(report_input, monitors)
    line = headline(result)
    around = [
        note
        for rate in metrics.rates
        for iteration in rate.iterations
        if (note := iteration.interference)
    ]
    return {
        "source": report_input,
        "result": result,
        "metrics": metrics,
        "counts": Counter(row.verdict.outcome for row in ordered),
        "requirements": [*zip(shown, result_table.reasons(shown), strict=True)],
        "more_requirements": len(ordered) - len(shown),
        "compared": [
            row
            for row in result_table.requirement_rows(result.verdict)
            if row.verdict.compared is not None
        ],
        "notes": notes(result),
        "line": line,
        "reason": reason_after(line, result.verdict),
        "profiles": [*profile_notes(result.profiles)],
        "anatomies": anatomies_of(result),
        "anatomy_table": anatomy_table,
        "has_interference": bool(around),
        "has_frequency": any(sample.frequency_hz for sample in around),
        "affected": defaultdict(
            str, {part.segment: "; ".join(part.reasons) for part in result.verdict.disturbed}
        ),
        "monitors": monitors,
        "processes": processes,
        "graph": lay_out(
            report_input.run.plan, _annotations(result, report_input.run.plan), _GRAPH_WIDTH
        )
        if report_input.run
        else None,
        "charts": {
            key: [_safe(chart) for chart in chart_list] for key, chart_list in charts.items()
        },
        "number": partial(_number, msgspec.to_builtins(result)),
        "measured": partial(result_table.measured, metrics),
        "iterations": lambda monitor: [
            *islice(result_table.measured_iterations(metrics, monitor), _MAX_SHOWN_ITERATIONS)
        ],
        "more_iterations": sum(len(rate.iterations) for rate in metrics.rates)
        - _MAX_SHOWN_ITERATIONS,
        "latency_columns": [result_table.METRICS[name] for name in _LATENCY_COLUMNS],
        "throughput_columns": [result_table.METRICS[name] for name in _THROUGHPUT_COLUMNS],
        "iteration_columns": [result_table.METRICS[name] for name in _ITERATION_COLUMNS],
        "main_parts": ("mean", *MAIN_PERCENTILES, "max"),
        "tail": TAIL_PERCENTILE,
        "facts": {key: _plain(value) for key, value in result.machine.items()},
        "dataset": {key: _plain(value) for key, value in result.dataset.items()},
        "style": own_style()["style"],
        "script": own_text("script.js"),
    }


def _safe(chart: Chart) -> dict[str, Any]:
    from markupsafe import Markup

    svg = Markup(chart.svg)  # noqa: S704 - serialised from a tree, which escapes every text
    return {"name": chart.name, "title": chart.title, "note": chart.note, "svg": svg}


def _plain(value: object) -> str:
    """A fact as text: lists and maps as JSON, nothing as a dash."""
    if isinstance(value, str | int | float):
        return str(value) if value != "" else "-"
    return msgspec.json.encode(value).decode() if value else "-"


def _charts(report_input: ReportInput, monitors: list[str]) -> dict[str, list[Chart]]:
    """The charts of each section of the page."""
    metrics, run = report_input.result.metrics, report_input.run
    charts: dict[str, list[Chart]] = {"offered": [], "loads": []}
    if any(rate.offered_hz for rate in metrics.rates):
        verdict = report_input.result.verdict
        charts["offered"].append(load_curve_chart("offered", metrics, run, verdict))
    if run is not None and (loads := loads_chart("loads", run)) is not None:
        charts["loads"].append(loads)
    return charts | {
        "latency": [*_latency_charts(report_input, monitors)],
        "anatomy": [*waterfalls(report_input.result)],
    }


def _latency_charts(report_input: ReportInput, monitors: list[str]) -> Iterator[Chart]:
    samples, verdict = report_input.samples, report_input.result.verdict
    if samples is None or not samples.iterations:
        return
    for number, monitor in enumerate(monitors):
        if not has_latencies(samples, monitor):
            continue
        yield percentile_chart(f"percentiles-{number}", monitor, samples, verdict)
        yield messages_chart(f"messages-{number}", monitor, samples, verdict)


def _annotations(result: Result, plan: Plan) -> dict[str, list[str]]:
    """The annotations of the graph: at the player, at each monitor, and where time was spent."""
    metrics = result.metrics
    rates = metrics.rates[-_MAX_SHOWN_RATES:]
    texts = {"player": [f"plays {show_rate(rate.offered_hz, rate.pace)}" for rate in rates]}
    for name in dict.fromkeys(name for rate in rates for name in rate.pooled.monitors):
        texts[f"monitor {name}"] = [
            f"{show_rate(rate.offered_hz, rate.pace)}: {show(seen.throughput_hz, 'Hz')}, "
            f"{part_title(TAIL_PERCENTILE)} {show(part_value(seen.latency, TAIL_PERCENTILE), 's')}"
            for rate in rates
            if (seen := rate.pooled.monitors[name])
        ]
    full = {node.node: node.name for process in plan.processes for node in process.nodes}
    for anatomy in anatomies_of(result)[-1:]:
        parts = [part for path in anatomy.paths for part in path.parts]
        # Of several paths through a topic, the one that most messages took comes first.
        for part in parts:
            if part.name == "transport":
                text = f"transport {show(part.p50, 's')}, p99 {show(part.p99, 's')}"
                texts.setdefault(f"topic {part.owner}", [text])
        for node in anatomy.nodes:
            texts[full.get(node.name, node.name)] = [
                f"callback {show(node.callback_p50, 's')}, p99 {show(node.callback_p99, 's')}",
                f"wait {show(node.wait_p50, 's')}, load {anatomy_table.share(node.load)}",
            ]
    return texts
