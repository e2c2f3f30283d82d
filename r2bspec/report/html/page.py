"""Documents as pages: a self-contained file each, with charts if the document is of a run."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Iterator
from typing import Final

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.measure.distribution import TAIL_PERCENTILE, part_title, part_value
from r2bspec.judge.measure.units import show, show_rate
from r2bspec.judge.result import Result
from r2bspec.plan.plan import Plan
from r2bspec.report import anatomy_table
from r2bspec.report.anatomy_table import anatomies_of
from r2bspec.report.document import Chart, Document, Section
from r2bspec.report.html.graph_drawing import lay_out
from r2bspec.report.html.latency_charts import has_latencies, messages_chart, percentile_chart
from r2bspec.report.html.load_charts import load_curve_chart, loads_chart
from r2bspec.report.html.template import PALETTE, fill, own_text
from r2bspec.report.result_document import result_document
from r2bspec.report.result_table import monitor_names

_GRAPH_WIDTH: Final = 990
"""Pixels: what a figure of the page is wide, where the window has the room."""

_MAX_SHOWN_RATES: Final = 4
"""Rates whose numbers are written into the drawing of the graph."""

_CONTROL_CHARACTERS: Final = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")
_WIDE: Final = "header,main{max-width:none}\n"
"""A drawing alone has the whole width of the window, or of the panel of an editor."""


def render(report_input: ReportInput) -> bytes:
    """Return the page of a run, UTF-8. The same run gives the same bytes."""
    charts = {
        "Graph": tuple(_graph(report_input)),
        "Measurements": tuple(_measurement_charts(report_input)),
        "Load": tuple(_load_charts(report_input)),
    }
    document = result_document(report_input, whole=True, charts=charts)
    return to_page(document, own_text("script.js"))


def to_page(document: Document, script: str = "") -> bytes:
    """Return a document as a page. The same document gives the same bytes."""
    return _page(document, _style(), script=script)


def render_graph(plan: Plan) -> bytes:
    """Return the drawing of a plan as a page, whose policy allows only its own style."""
    from r2bspec.plan.time_estimate import estimate_time

    figure = _graph_chart(plan, {}, None)
    document = Document(
        line=f"The graph of {plan.title or plan.name}",
        facts=(f"A run takes {estimate_time(plan).text()}.",),
        sections=(Section("Graph", (figure,)),),
    )
    style = _style(_WIDE)
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    return _page(document, style, style_hash=f"sha256-{digest}")


def _page(document: Document, style: str, **context: str) -> bytes:
    """Fill the template; every text of the document is escaped.

    The names of a page that is given no script have no hash of its style.
    """
    from markupsafe import Markup

    text = fill(
        "page.html.j2",
        document=document,
        style=Markup(style),  # noqa: S704 - our file
        style_hash=context.get("style_hash", ""),
        script=Markup(context.get("script", "")),  # noqa: S704 - our file
    )
    # HTML cannot contain control characters and the lone surrogates of broken file names.
    plain = _CONTROL_CHARACTERS.sub("\N{REPLACEMENT CHARACTER}", text)
    return plain.encode("utf-8", errors="replace") + b"\n"


def _style(extra: str = "") -> str:
    """Return the stylesheet, with a class for each colour of drawings."""
    colours = "".join(
        f".f-{name}{{fill:var(--{name})}}.k-{name}{{stroke:var(--{name})}}\n" for name in PALETTE
    )
    return own_text("style.css") + extra + colours


# The charts of a run.


def _graph(report_input: ReportInput) -> Iterator[Chart]:
    if report_input.run is not None:
        plan = report_input.run.plan
        yield _graph_chart(plan, _annotations(report_input.result, plan), _GRAPH_WIDTH)


def _graph_chart(plan: Plan, annotations: dict[str, list[str]], width: float | None) -> Chart:
    graph = lay_out(plan, annotations) if width is None else lay_out(plan, annotations, width)
    svg = fill("graph.svg.j2", graph=graph, name=plan.name)
    tail = part_title(TAIL_PERCENTILE)
    what = f", with throughput and {tail} latency at the monitors" if annotations else ""
    return Chart("graph-drawing", f"The graph by phase of the run{what}.", svg, wide=True)


def _measurement_charts(report_input: ReportInput) -> Iterator[Chart]:
    metrics, verdict = report_input.result.metrics, report_input.result.verdict
    samples = report_input.samples
    if samples is not None and samples.iterations:
        for number, monitor in enumerate(monitor_names(metrics)):
            if has_latencies(samples, monitor):
                yield percentile_chart(f"percentiles-{number}", monitor, samples, verdict)
                yield messages_chart(f"messages-{number}", monitor, samples, verdict)
    if any(rate.offered_hz for rate in metrics.rates):
        yield load_curve_chart("offered", metrics, verdict)


def _load_charts(report_input: ReportInput) -> Iterator[Chart]:
    if report_input.run is not None and (chart := loads_chart("loads", report_input.run)):
        yield chart


def _annotations(result: Result, plan: Plan) -> dict[str, list[str]]:
    """Return the words beside player and monitors, and where time was spent."""
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
