"""From a result to the page: the template's context, and the charts."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import msgspec

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.measure.distribution import (
    MAIN_PERCENTILES,
    PARTS,
    SHORT_PERCENTILES,
    TAIL_PERCENTILE,
    part_title,
    part_value,
)
from r2bspec.measure.metrics import RunMetrics
from r2bspec.measure.units import at_rate, show, show_rate
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import ProfileRecord
from r2bspec.report.headline import headline, reason_after
from r2bspec.report.html.canvas import Chart
from r2bspec.report.html.number_links import Numbers
from r2bspec.report.html.page_templates import own_text, render_template
from r2bspec.report.html.svg import PALETTE
from r2bspec.report.notes import notes, profile_notes
from r2bspec.report.report_wording import (
    OUTCOME_WORDS,
    PROBE_PURPOSES,
    bounds_text,
    code_facts,
    code_text,
    comparison,
    estimate_text,
    loaded_rmw,
    own_pace,
    peak_text,
    reasons,
    requirement_text,
    several_monitors,
    starts_text,
    verdict_word,
)

if TYPE_CHECKING:
    from r2bspec.report.html.graph_drawing import Drawing

_ORDER = ("fail", "inconclusive", "pass")

_MAX_SHOWN_RATES = 4
"""Rates whose numbers are written into the drawing of the graph."""


def render(report_input: ReportInput) -> bytes:
    """The page, UTF-8. The same run gives the same bytes."""
    return render_template("page.html.j2", _context(report_input))


def _context(report_input: ReportInput) -> dict[str, Any]:
    result = report_input.result
    metrics = result.metrics
    several = several_monitors(result.verdict)
    indices = {id(one): number for number, one in enumerate(result.verdict.requirements)}
    ordered = sorted(result.verdict.requirements, key=lambda one: _ORDER.index(one.outcome))
    monitors = [*dict.fromkeys(name for rate in metrics.rates for name in rate.pooled.monitors)]
    processes = [*dict.fromkeys(name for rate in metrics.rates for name in rate.pooled.processes)]
    charts = _charts(report_input, monitors)
    line = headline(result)
    return {
        "result": result,
        "metrics": metrics,
        "words": OUTCOME_WORDS,
        "counts": _counts(ordered),
        "has_lost": any(one.lost for one in ordered),
        "requirements": [
            {
                "one": one,
                "index": indices[id(one)],
                "word": verdict_word(one),
                "text": requirement_text(one, name_monitor=several),
                "estimate": estimate_text(one),
                "bounds": bounds_text(one),
                "reasons": texts,
            }
            for one, texts in zip(ordered, reasons(ordered, name_monitor=several), strict=True)
        ],
        "notes": notes(result),
        "line": line,
        "reason": reason_after(line, result.verdict),
        "suite_link": report_input.suite_link,
        "profiles": [*profile_notes(result.profiles)],
        "comparison": [*comparison(result)],
        "compared": [
            {"one": one, "index": number, "text": requirement_text(one, name_monitor=several)}
            for number, one in enumerate(result.verdict.requirements)
            if one.compared is not None
        ],
        "has_interference": any(
            one.interference for rate in metrics.rates for one in rate.iterations
        ),
        "affected": defaultdict(
            str, {one.segment: "; ".join(one.reasons) for one in result.verdict.disturbed}
        ),
        "monitors": monitors,
        "monitor_title": result.monitor_title,
        "processes": processes,
        "purposes": PROBE_PURPOSES,
        "peak": peak_text(metrics.search) if metrics.search is not None else "",
        "graph": _graph(report_input),
        "charts": {key: [_safe(chart) for chart in found] for key, found in charts.items()},
        "baseline": report_input.baseline.record if report_input.baseline is not None else None,
        "has_samples": report_input.run is not None,
        "number": Numbers(msgspec.to_builtins(result)),
        "parts": PARTS,
        "main_parts": ("mean", *MAIN_PERCENTILES, "max"),
        "short_parts": (*SHORT_PERCENTILES, "max"),
        "tail": TAIL_PERCENTILE,
        "part_title": part_title,
        "show": show,
        "show_rate": show_rate,
        "at_rate": at_rate,
        "pace": own_pace(metrics),
        "facts": {key: _plain(value) for key, value in result.machine.items()},
        "rmw": loaded_rmw(result),
        "code": code_text(result),
        "code_facts": code_facts(result),
        "starts": starts_text(result.starts),
        "dataset": {key: _plain(value) for key, value in result.dataset.items()},
        "palette": PALETTE,
        "style": own_text("style.css"),
        "script": own_text("script.js"),
    }


def _safe(chart: Chart) -> dict[str, Any]:
    from markupsafe import Markup

    svg = Markup(chart.svg)  # noqa: S704 - serialised from a tree, which escapes every text
    return {"name": chart.name, "title": chart.title, "note": chart.note, "svg": svg}


def _counts(requirements: Sequence[RequirementVerdict]) -> list[tuple[str, int]]:
    outcomes = [one.outcome for one in requirements]
    return [(outcome, outcomes.count(outcome)) for outcome in _ORDER if outcome in outcomes]


def _plain(value: object) -> str:
    """A fact as text: lists and maps as JSON, nothing as a dash."""
    if isinstance(value, str | int | float):
        return str(value) if value != "" else "-"
    return msgspec.json.encode(value).decode() if value else "-"


def _charts(report_input: ReportInput, monitors: list[str]) -> dict[str, list[Chart]]:
    metrics = report_input.result.metrics
    found: dict[str, list[Chart]] = {
        each: [] for each in ("latency", "offered", "loads", "baseline", "profiles")
    }
    if any(rate.offered_hz for rate in metrics.rates):
        from r2bspec.report.html.load_curve import load_curve_chart

        verdict = report_input.result.verdict
        found["offered"].append(load_curve_chart("offered", metrics, report_input.run, verdict))
    if report_input.run is not None:
        found["latency"] = [*_latency_charts(report_input, monitors)]
        found["baseline"] = [*_baseline_charts(report_input, monitors)]
        from r2bspec.report.html.load_chart import loads_chart

        loads = loads_chart("loads", report_input.run)
        found["loads"] = [loads] if loads is not None else []
        found["profiles"] = [*_flame_graphs(report_input.run)]
    return found


def _flame_graphs(run: Run) -> Iterator[Chart]:
    """A flame graph of each profile with folded stacks that can be read."""
    for number, one in enumerate(run.record.profiles):
        if one.stacks and (chart := _flame_graph(f"profile-{number}", run, one)) is not None:
            yield chart


def _flame_graph(name: str, run: Run, profile: ProfileRecord) -> Chart | None:
    from r2bspec.record.run_folder import read_stacks
    from r2bspec.report.html.flame_graph import flame_graph

    try:
        stacks = read_stacks(run.folder / profile.stacks, run.folder)
    except (OSError, ValueError):
        return None
    at = f" {at_rate(profile.rate_hz)}" if profile.rate_hz else ""
    title = f"Where {profile.process} spends its CPU time{at}, seen by {profile.profiler}"
    return flame_graph(name, title, stacks)


def _latency_charts(report_input: ReportInput, monitors: list[str]) -> Iterator[Chart]:
    from r2bspec.report.html.message_chart import messages_chart
    from r2bspec.report.html.percentile_curve import percentile_chart

    samples, run = report_input.samples, report_input.run
    verdict = report_input.result.verdict
    if samples is None or run is None or not samples.iterations:
        return
    for number, monitor in enumerate(monitors):
        yield percentile_chart(f"percentiles-{number}", monitor, samples, verdict)
        rates = sorted(samples.iterations)
        yield messages_chart(f"messages-{number}", monitor, run, rates, verdict)


def _baseline_charts(report_input: ReportInput, monitors: list[str]) -> Iterator[Chart]:
    from r2bspec.report.html.latency_distribution import ecdf_chart

    samples, baseline = report_input.samples, report_input.baseline_samples
    if samples is None or baseline is None:
        return
    for number, monitor in enumerate(monitors):
        chart = ecdf_chart(f"ecdf-{number}", monitor, samples, baseline)
        if chart is not None:
            yield chart


def _graph(report_input: ReportInput) -> Drawing | None:
    if report_input.run is None:
        return None
    from r2bspec.report.html.graph_drawing import lay_out

    return lay_out(report_input.run.plan, _annotations(report_input.result.metrics))


def _annotations(metrics: RunMetrics) -> dict[str, list[str]]:
    """The annotations of the graph at the player and at each monitor."""
    rates = metrics.rates[-_MAX_SHOWN_RATES:]
    found = {"player": [f"plays {show_rate(rate.offered_hz, rate.pace)}" for rate in rates]}
    for name in dict.fromkeys(name for rate in rates for name in rate.pooled.monitors):
        found[f"monitor {name}"] = [
            f"{show_rate(rate.offered_hz, rate.pace)}: {show(seen.throughput_hz, 'Hz')}, "
            f"{part_title(TAIL_PERCENTILE)} {show(part_value(seen.latency, TAIL_PERCENTILE), 's')}"
            for rate in rates
            if (seen := rate.pooled.monitors[name])
        ]
    return found
