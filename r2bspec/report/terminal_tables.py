"""The tables of the report in the terminal: monitors, hops, load, overhead and phases.

A monitor has a line for each rate, with the range over iterations below. The latency of the hops on
the path to a tapped monitor has one line a hop. The load is the lateness of the playback, CPU and
memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from r2bspec.judge.measure.distribution import (
    MAIN_PERCENTILES,
    SHORT_PERCENTILES,
    TAIL_PERCENTILE,
    part_title,
    part_value,
)
from r2bspec.judge.measure.metrics import RateMetrics, RunMetrics, UseMetrics
from r2bspec.judge.measure.units import at_rate, show, show_range, show_rate, significant
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import OverallOutcome, Verdict
from r2bspec.record.run_record import HarnessOverheadRecord
from r2bspec.report import anatomy_table
from r2bspec.report import report_wording as wording
from r2bspec.report.output import MAX_TABLE_ROWS, rows_left_out
from r2bspec.report.result_table import (
    HOP_COLUMNS,
    METRICS,
    Measured,
    hop_cells,
    measured,
    monitor_names,
)

OUTCOME_STYLES: dict[OverallOutcome, str] = {
    "pass": "bold green",
    "fail": "bold red",
    "inconclusive": "bold yellow",
    "invalid": "bold magenta",
    "incomplete": "bold magenta",
}

DIM_STYLE = "dim"


def overall_text(verdict: Verdict) -> Text:
    """The outcome of a run as a word with its mark and colour."""
    return Text(wording.overall_word(verdict), style=OUTCOME_STYLES[verdict.outcome])


def heading(text: str, aside: str = "") -> Text:
    """A section's heading, with a dimmed aside."""
    return Text.assemble((text, "bold"), (f"  {aside}" if aside else "", DIM_STYLE))


class _BoundedTable(Table):
    """Shows the first rows, and how many there are more."""

    more = 0

    def add_row(self, *cells: RenderableType | None, **options: Any) -> None:
        """See `Table.add_row`."""
        if self.row_count < MAX_TABLE_ROWS:
            super().add_row(*cells, **options)
        else:
            self.more += 1

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield from super().__rich_console__(console, options)
        if self.more:
            yield Text(rows_left_out(self.more), style=DIM_STYLE)


def table(columns: Sequence[str]) -> Table:
    """A table whose first column is a name and whose others are numbers."""
    grid = _BoundedTable(
        box=None,
        pad_edge=False,
        padding=(0, 2, 0, 0),
        header_style=DIM_STYLE,
    )
    for number, name in enumerate(columns):
        grid.add_column(name, justify="left" if number == 0 else "right", no_wrap=True)
    return grid


_MIN_WIDTHS = {
    "throughput.mean": 0,
    **{
        f"latency.{part}": 0 if part in (*SHORT_PERCENTILES, "max") else 100
        for part in (*MAIN_PERCENTILES, "max")
    },
    f"jitter.{TAIL_PERCENTILE}": 110,
    "sent": 0,
    "missed": 0,
    "received": 0,
}
"""The columns of a monitor: each metric, with the width of the report from which it is shown."""

_ANSWER_COLUMNS, _OWN_PACE_COLUMNS = ("sent", "missed"), ("received",)
"""Columns of outputs that answer inputs, and of those of which no number is expected."""


def monitor_sections(result: Result, width: int) -> Iterator[RenderableType]:
    """A table for each monitor of the run."""
    metrics = result.metrics
    for name in monitor_names(metrics):
        rows = [*measured(metrics, name)]
        own_pace = any(row.seen.age is not None for row in rows)
        hidden = _ANSWER_COLUMNS if own_pace else _OWN_PACE_COLUMNS
        columns = [
            metric
            for metric, min_width in _MIN_WIDTHS.items()
            if min_width <= width and metric not in hidden
        ]
        live = any(row.rate.pace == "source" for row in rows)
        family = "age" if own_pace and not live else "latency"
        yield _section(result.monitor_title(name), rows, columns, family)


def _section(title: str, rows: list[Measured], columns: list[str], family: str) -> RenderableType:
    """The table of a monitor, with one family of times."""
    titles = [METRICS[metric].title for metric in columns]
    grid = table(["offered", *titles])
    columns = [metric.replace("latency.", f"{family}.") for metric in columns]
    aside = family
    for row in rows:
        grid.add_row(row.offered, *map(row.text, columns))
        count = len(row.rate.iterations)
        if count > 1:
            aside = f"{family}; below each line, the range over the iterations"
            ranges = (f"× {count}", *map(row.range_text, columns))
            grid.add_row(*(Text(text, style=DIM_STYLE) for text in ranges))
    return Group(heading(title, aside), grid)


def hop_sections(metrics: RunMetrics) -> Iterator[RenderableType]:
    """A table for each tapped monitor at each rate."""
    for row in measured(metrics):
        if not row.seen.hops:
            continue
        grid = table(HOP_COLUMNS)
        for hop in row.seen.hops:
            grid.add_row(*hop_cells(hop))
        at = at_rate(row.rate.offered_hz, row.rate.pace)
        aside = f"path to {row.monitor} {at}; percentiles do not add up"
        yield Group(heading("hops", aside), grid)


def anatomy_sections(result: Result, *, verbose: bool) -> Iterator[RenderableType]:
    """For each observed rate a table of the parts of each path, and one of the nodes.

    Without `verbose` only the first path to each monitor, which most messages took.
    """
    for anatomy in anatomy_table.anatomies_of(result):
        first = {path.monitor: path for path in reversed(anatomy.paths)}
        for path in anatomy.paths:
            if not verbose and path is not first[path.monitor]:
                continue
            grid = table(anatomy_table.PART_COLUMNS)
            grid.columns[1].justify = "left"
            for row in anatomy_table.part_rows(path):
                grid.add_row(*row)
            caption = Text(anatomy_table.caption(path), style=DIM_STYLE)
            yield Group(heading("anatomy", anatomy_table.title(anatomy, path)), caption, grid)
        lines = [*anatomy_table.anatomy_notes(anatomy)]
        if more := len(anatomy.paths) - len(first):
            lines += [] if verbose else [f"--verbose shows the other paths, {more} more"]
        grid = table(anatomy_table.NODE_COLUMNS)
        for row in anatomy_table.node_rows(anatomy):
            grid.add_row(*row)
        same = "the same" if first else "one"
        about = f"in {same} iteration; {anatomy_table.NODES_CAPTION}"
        if grid.rows:
            yield Group(heading("nodes", about), grid)
        if lines:
            yield Text("\n".join(lines), style=DIM_STYLE)


_MEMORY_WIDTH = 9
_FAULTS_WIDTH = 9
_RATE_WIDTH = 17
"""Columns with their gaps, at their widest: ``1,023 MiB``, ``12,345`` and ``251 µs (348 µs)``."""

_PLAYED_LABEL = "playback rate"
_FREQUENCY_LABEL = "CPU frequency"
_LATE_LABEL = f"lateness {part_title(TAIL_PERCENTILE)} (max)"


def load_section(metrics: RunMetrics, width: int) -> RenderableType | None:
    """A line for each process and a column for each rate; None without rates."""
    rates = metrics.rates
    if not rates:
        return None
    # Many rates are split into several tables.
    names = [name for rate in rates for name in rate.pooled.processes]
    name_width = max(map(len, (*names, _LATE_LABEL))) + 2
    across = max(1, (width - name_width - _MEMORY_WIDTH - _FAULTS_WIDTH) // _RATE_WIDTH)
    return Group(
        heading("load", "CPU mean (max); 100 % is one core; minor page faults a message"),
        *(_load_table(rates[start : start + across]) for start in range(0, len(rates), across)),
    )


def harness_overhead_section(overheads: tuple[HarnessOverheadRecord, ...]) -> RenderableType | None:
    """The latency of harness and transport without the graph; None if not measured."""
    if not overheads:
        return None
    grid = table(["input", "size", "at", "p50", "p99", "received"])
    for overhead in overheads:
        grid.add_row(
            overhead.topic,
            show(float(overhead.bytes), "B"),
            show_rate(overhead.rate_hz, "recording"),
            *(_ns(value) for value in (overhead.latency_p50_ns, overhead.latency_p99_ns)),
            f"{overhead.received} of {overhead.sent}",
        )
    where = wording.overhead_placement(overheads)
    what = f"latency without the graph{where and ', '}{where}; included in the latencies above"
    return Group(heading("harness overhead", what), grid)


def _ns(value: int | None) -> str:
    return "-" if value is None else show(value / 1e9, "s")


def _load_table(rates: tuple[RateMetrics, ...]) -> RenderableType:
    columns = ["process", *(show_rate(rate.offered_hz, rate.pace) for rate in rates), "memory"]
    grid = table([*columns, "faults"])
    names = dict.fromkeys(name for rate in rates for name in rate.pooled.processes)
    of_processes = []
    for name in names:
        uses = [rate.pooled.processes.get(name) for rate in rates]
        of_processes.append([*map(_cpu, uses), _memory(uses)])
        grid.add_row(name, *of_processes[-1], _faults(uses))
    graph = [rate.pooled.graph for rate in rates]
    # Of a graph in one process its row says the same.
    together = [*map(_cpu, graph), _memory(graph)]
    if any(graph) and together not in of_processes:
        grid.add_row("whole graph", *map(_cpu, graph), _memory(graph), _faults(graph))
    machine = [rate.pooled.machine for rate in rates]
    if any(machine):
        grid.add_row("whole machine", *map(_cpu, machine), _memory(machine), "")
    frequencies = [_frequencies(rate) for rate in rates]
    if any(frequencies):
        grid.add_row(_FREQUENCY_LABEL, *(text or "-" for text in frequencies), "", "")
    if any(rate.pooled.playback.sent is not None for rate in rates):
        grid.add_row(
            _PLAYED_LABEL, *(show(rate.pooled.playback.rate_hz, "Hz") for rate in rates), "", ""
        )
        grid.add_row(_LATE_LABEL, *map(_lateness, rates), "", "")
    return grid


def _frequencies(rate: RateMetrics) -> str:
    """The range over the iterations; empty if it is unknown."""
    around = (iteration.interference for iteration in rate.iterations)
    frequencies = [
        sample.frequency_hz for sample in around if sample is not None and sample.frequency_hz
    ]
    return show_range(min(frequencies), max(frequencies), "Hz") if frequencies else ""


def _cpu(use: UseMetrics | None) -> str:
    if use is None or use.cpu_mean is None or use.cpu_max is None:
        return "-"
    return f"{_percent(use.cpu_mean)} ({_percent(use.cpu_max)}) %"


def _percent(share: float) -> str:
    """Whole percents from 10 on: processor time has no finer resolution."""
    return significant(share * 100, 2) if share < 0.1 else f"{share * 100:.0f}"


def _memory(uses: list[UseMetrics | None]) -> str:
    memories = [use.memory_max_bytes for use in uses if use and use.memory_max_bytes is not None]
    return show(float(max(memories)), "B") if memories else "-"


def _faults(uses: list[UseMetrics | None]) -> str:
    faults = [use.faults_per_message for use in uses if use and use.faults_per_message is not None]
    return significant(max(faults), 2) if faults else "-"


def _lateness(rate: RateMetrics) -> str:
    late = rate.pooled.playback.lateness
    return f"{show(part_value(late, TAIL_PERCENTILE), 's')} ({show(late.max, 's')})"
