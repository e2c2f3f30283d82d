"""Histories as documents, as CSV and as JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from statistics import median
from typing import Final

import msgspec

from r2bspec.compare.history import Change, History, MetricHistory
from r2bspec.diagnostics.plain_text import harmless, plain_values
from r2bspec.diagnostics.quote import pluralize
from r2bspec.judge.measure.units import at_rate, show
from r2bspec.judge.statistics.change_points import MIN_RESULTS
from r2bspec.report.data_formats import csv_text
from r2bspec.report.document import (
    Cell,
    Chart,
    Column,
    Document,
    Items,
    Paragraph,
    Row,
    Section,
    Table,
)
from r2bspec.report.format_registry import ReportUsageError

TREND_FORMATS: Final = ("text", "json", "markdown", "html", "csv")
"""By the names of the formats of a run."""

_BARS: Final = "▁▂▃▄▅▆▇█"
_MOST_BARS: Final = 24
"""In a line of text, and in the width of a phone."""

_MAX_LEFT_OUT: Final = 10
_COLUMNS: Final = (
    Column("metric", number=False),
    Column("history"),
    Column("last"),
    Column("last change"),
)


def render(name: str, histories: Sequence[History], left_out: Sequence[str]) -> bytes:
    """Return histories in one of the `TREND_FORMATS`.

    Args:
        name: the name of the format.
        histories: at least one.
        left_out: a sentence for each file that is in none.

    Raises:
        ReportUsageError: a table of CSV is asked for, and there are several benchmarks.
    """
    if name == "json":
        content = {"r2bspec_histories": 1, "histories": list(histories), "left_out": list(left_out)}
        return msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n"
    histories, left_out = plain_values((tuple(histories), tuple(left_out)))
    if name == "csv":
        return harmless(_csv(histories)).encode()
    if name == "html":
        return harmless(_page(histories, left_out).decode()).encode()
    document = trend_document(histories, left_out)
    if name == "markdown":
        from r2bspec.report.markdown import to_markdown

        return harmless(to_markdown(document)).encode()
    from r2bspec.report.terminal import to_text

    return harmless(to_text(document, whole_tables=True)).encode()


def _page(histories: Sequence[History], left_out: Sequence[str]) -> bytes:
    from r2bspec.report.html.page import to_page
    from r2bspec.report.html.trend_charts import trend_chart, trend_script

    charts = []
    for number, history in enumerate(histories):
        for metric in history.metrics:
            labels = [
                f"{_growth_text(change)} since {history.results[change.after].called}"
                for change in metric.changes
            ]
            charts.append(trend_chart(number, history, metric, _metric_title(metric), labels))
    return to_page(trend_document(histories, left_out, charts), trend_script(histories))


def trend_document(
    histories: Sequence[History],
    left_out: Sequence[str],
    charts: Iterable[Chart] = (),
) -> Document:
    """Return the report of histories, with the charts of all metrics in their order."""
    results = sum(len(history.results) for history in histories)
    changes = sum(len(metric.changes) for history in histories for metric in history.metrics)
    drawn = iter(charts)
    sections = [
        Section(history.name, (*_blocks(history), *islice(drawn, len(history.metrics))))
        for history in histories
    ]
    if left_out:
        more = len(left_out) - _MAX_LEFT_OUT
        others = (f"{more} more: --report json=FILE has all",) if more > 0 else ()
        sections.append(Section("Left out", (Items((*left_out[:_MAX_LEFT_OUT], *others)),)))
    return Document(
        line=f"{pluralize(results, 'result')}, {pluralize(changes, 'change point')}",
        sections=tuple(sections),
    )


def _blocks(history: History) -> Iterator[Table | Paragraph]:
    first, last = history.results[0], history.results[-1]
    span = pluralize(len(history.results), "result")
    span += f" from {first.called} to {last.called}" if last is not first else f": {first.called}"
    # What has changed stands first.
    metrics = sorted(history.metrics, key=lambda metric: not metric.changes)
    rows = tuple(_row(history, metric) for metric in metrics)
    yield Table(history.name, _COLUMNS, rows, aside=span)
    counts = Counter(result.environment for result in history.results)
    if max(counts.values()) < MIN_RESULTS:
        text = f"A change point takes at least {MIN_RESULTS} results of the same environment."
        yield Paragraph(text, quiet=True)
    for text in _environment_texts(history):
        yield Paragraph(text, quiet=True)


def _environment_texts(history: History) -> Iterator[str]:
    """Yield what is new in each environment."""
    for index in range(1, len(history.environments)):
        called = history.results[history.first_of(index)].called
        yield f"Not compared with what is before {called}: {history.environment_change(index)}"


def _metric_title(metric: MetricHistory) -> str:
    """Return a metric with its monitor and its rate."""
    name = f"{metric.monitor}.{metric.metric}" if metric.monitor else metric.metric
    return name if metric.offered_hz is None else f"{name} {at_rate(metric.offered_hz)}"


def _row(history: History, metric: MetricHistory) -> Row:
    cells = (
        Cell(_metric_title(metric), code=True),
        Cell(_sparkline(history, metric)),
        Cell(show(metric.last, metric.unit), metric.last),
        Cell(_growth_text(metric.changes[-1]) if metric.changes else ""),
    )
    texts = "; ".join(_change_text(history, metric, one) for one in metric.changes)
    outcome = {"worse": "fail", "improved": "pass"}
    return Row(
        cells,
        (texts,) if texts else (),
        outcome[metric.changes[-1].outcome] if metric.changes else "",
    )


def _growth_text(change: Change) -> str:
    """Return ``12 % worse``."""
    share = f"{show(abs(change.ratio), 'share', 2)} " if change.ratio is not None else ""
    return f"{share}{change.outcome}"


def _change_text(history: History, metric: MetricHistory, change: Change) -> str:
    """Return a change point in a sentence."""
    before, after = (history.results[place] for place in (change.before, change.after))
    values = (show(value, metric.unit) for value in (change.mean_before, change.mean_after))
    # Never 100 %: the text has as many digits as permutations can show.
    confidence = show(min(change.confidence, 0.9999), "share", 4)
    return (
        f"{_growth_text(change)} since {after.called} (last before: {before.called}): "
        f"{' → '.join(values)}, {confidence} confidence"
    )


def _sparkline(history: History, metric: MetricHistory) -> str:
    """Return medians of equal stretches as bars, with a line before each new environment."""
    size = -(-len(metric.values) // _MOST_BARS)
    firsts = range(0, len(metric.values), size)
    medians = []
    for first in firsts:
        known = [value for value in metric.values[first : first + size] if value is not None]
        medians.append(median(known) if known else None)
    shown = [value for value in medians if value is not None]
    low, high = min(shown, default=0.0), max(shown, default=0.0)
    seen = {history.results[0].environment}
    bars = []
    for first, value in zip(firsts, medians, strict=True):
        environments = {one.environment for one in history.results[first : first + size]}
        if environments - seen:
            seen |= environments
            bars.append("│")
        level = (value - low) / (high - low) if value is not None and high > low else 0.0
        bars.append(" " if value is None else _BARS[round(level * (len(_BARS) - 1))])
    return "".join(bars)


def _csv(histories: Sequence[History]) -> str:
    """Return a row for each result, as Otava reads them: time, commit, metrics."""
    if len(histories) > 1:
        names = ", ".join(history.name for history in histories)
        raise ReportUsageError(
            f"a table of CSV has one benchmark, and there are {names}",
            hint="Put {name} into the path, as in csv=history-{name}.csv.",
        )
    (history,) = histories
    header = ("time", "commit", *(_column(metric) for metric in history.metrics))
    rows = (
        (
            *(result.started_at, result.commit or result.run_id),
            *(metric.values[place] for metric in history.metrics),
        )
        for place, result in enumerate(history.results)
    )
    return csv_text(header, rows)


def _column(metric: MetricHistory) -> str:
    name = f"{metric.monitor}.{metric.metric}" if metric.monitor else metric.metric
    return name if metric.offered_hz is None else f"{name}@{metric.offered_hz:g}Hz"
