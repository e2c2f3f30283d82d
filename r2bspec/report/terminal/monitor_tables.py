"""The measurements of each monitor: a line for each rate, with the range over iterations below."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from rich.console import Group, RenderableType
from rich.text import Text

from r2bspec.judge.result import Result
from r2bspec.measure.distribution import (
    MAIN_PERCENTILES,
    SHORT_PERCENTILES,
    TAIL_PERCENTILE,
    part_title,
    part_value,
)
from r2bspec.measure.metrics import MonitorMetrics, RateMetrics
from r2bspec.measure.units import show, show_range, show_rate
from r2bspec.report.terminal.style import DIM_STYLE, heading, table


@dataclass(frozen=True)
class _Column:
    """A column: the metric of the range below the value, and the width from which it is shown."""

    name: str
    unit: str
    value: Callable[[MonitorMetrics], float | None]
    spread: str = ""
    min_width: int = 0


def _latency_column(part: str) -> _Column:
    narrow = part in (*SHORT_PERCENTILES, "max")
    return _Column(
        part_title(part),
        "s",
        lambda seen: part_value(seen.latency, part),
        f"latency.{part}",
        0 if narrow else 100,
    )


_COLUMNS = (
    _Column("throughput", "Hz", lambda seen: seen.throughput_hz, "throughput.mean"),
    *(_latency_column(part) for part in (*MAIN_PERCENTILES, "max")),
    _Column(
        f"jitter {part_title(TAIL_PERCENTILE)}",
        "s",
        lambda seen: part_value(seen.jitter, TAIL_PERCENTILE),
        f"jitter.{TAIL_PERCENTILE}",
        110,
    ),
    _Column("sent", "count", lambda seen: seen.sent),
    _Column("missed", "count", lambda seen: seen.missed),
    _Column("received", "count", lambda seen: seen.received),
)

_PLAYED_COLUMNS, _LIVE_COLUMNS = ("sent", "missed"), ("received",)
"""Columns of a run with playback, and of a live run, in which what was sent is unknown."""


def monitor_sections(result: Result, width: int) -> Iterator[RenderableType]:
    """A table for each monitor of the run."""
    metrics = result.metrics
    names = dict.fromkeys(name for rate in metrics.rates for name in rate.pooled.monitors)
    live = any(rate.pace == "source" for rate in metrics.rates)
    columns = [
        column
        for column in _COLUMNS
        if column.min_width <= width
        and column.name not in (_PLAYED_COLUMNS if live else _LIVE_COLUMNS)
    ]
    for name in names:
        yield _section(name, result.monitor_title(name), metrics.rates, columns)


def _section(
    name: str, title: str, rates: tuple[RateMetrics, ...], columns: list[_Column]
) -> RenderableType:
    made = table(["offered", *(column.name for column in columns)])
    for rate in rates:
        seen = rate.pooled.monitors[name]
        made.add_row(
            show_rate(rate.offered_hz, rate.pace),
            *(show(column.value(seen), column.unit) for column in columns),
        )
        if len(rate.iterations) > 1:
            made.add_row(
                Text(f"× {len(rate.iterations)}", style=DIM_STYLE),
                *(Text(_spread(rate, name, column), style=DIM_STYLE) for column in columns),
            )
    aside = "latency"
    if any(len(rate.iterations) > 1 for rate in rates):
        aside += "; below each line, the range over the iterations"
    return Group(heading(title, aside), made)


def _spread(rate: RateMetrics, monitor: str, column: _Column) -> str:
    """The range of a metric over the iterations, or nothing if there is none."""
    spread = rate.spread[monitor].get(column.spread)
    return show_range(spread.low, spread.high, column.unit) if spread is not None else ""
