"""Comparisons of stored results in several formats."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import msgspec

from r2bspec.compare.comparison import ADVICE, Comparison, ComparisonLine, Outcome
from r2bspec.diagnostics.plain_text import harmless, plain_values
from r2bspec.judge.measure.units import at_rate, show
from r2bspec.report.markdown import code, escaped, folded, table
from r2bspec.report.output import printed_text
from r2bspec.report.report_wording import interval_text

if TYPE_CHECKING:
    from rich.console import Console


def render(comparisons: Sequence[Comparison], name: str, width: int = 100) -> bytes:
    """The comparison as bytes, UTF-8.

    Args:
        comparisons: one for each result that was compared with the base; at least one.
        name: of the format, as `r2bspec compare --format` lists them.
        width: of lines of text, in columns.
    """
    if name == "json":
        return to_json(comparisons)
    plain = plain_values(list(comparisons))
    text = to_text(plain, width) if name == "text" else to_markdown(plain)
    return harmless(text).encode()


OUTCOME_TEXTS: dict[Outcome, str] = {
    "improved": "▲ improved",
    "worse": "▼ worse",
    "same": "= same",
    "can't tell": "? can't tell",
}

_ORDER: tuple[Outcome, ...] = ("worse", "can't tell", "improved", "same")

_COLUMNS = ("", "metric", "base", "head", "ratio", "bounds")


def to_json(comparisons: Sequence[Comparison]) -> bytes:
    """A list with one object for each result that was compared with the base."""
    return msgspec.json.format(msgspec.json.encode(list(comparisons)), indent=2) + b"\n"


def to_text(comparisons: Sequence[Comparison], width: int = 100) -> str:
    """A table for each, its lines in the order of rates and metrics."""
    return printed_text(lambda page: _print_tables(comparisons, page), max(width, 60))


def _print_tables(comparisons: Sequence[Comparison], page: Console) -> None:
    from rich.text import Text

    from r2bspec.report.terminal_tables import DIM_STYLE, heading
    from r2bspec.report.terminal_tables import table as frame

    for comparison in comparisons:
        page.print(heading(title(comparison), ""))
        for difference in comparison.differences:
            page.print(f"  ! {difference}", markup=False, highlight=False)
        grid = frame(_COLUMNS)
        # Where there is little room, these two are folded, and outcomes and values stay whole.
        for column in (grid.columns[1], grid.columns[-1]):
            column.no_wrap, column.overflow = False, "fold"
        for line in comparison.lines:
            cells = (metric_text(line), *numbers(line))
            grid.add_row(Text(OUTCOME_TEXTS[line.outcome]), *map(Text, cells))
        page.print(grid)
        page.print(summary(comparison), highlight=False)
        page.print()
    page.print(Text(ADVICE, style=DIM_STYLE))


def to_markdown(comparisons: Sequence[Comparison]) -> str:
    """What has changed visible, the rest folded."""
    return (
        "\n".join(line for comparison in comparisons for line in _markdown(comparison))
        + f"\n{ADVICE}\n"
    )


def _markdown(one: Comparison) -> Iterator[str]:
    yield f"### {escaped(title(one))}"
    yield ""
    yield escaped(summary(one))
    yield ""
    yield from (f"> Difference: {escaped(difference)}  " for difference in one.differences)
    yield ""
    changed = [line for line in one.lines if line.outcome != "same"]
    changed.sort(key=lambda line: _ORDER.index(line.outcome))
    if changed:
        yield from table(_COLUMNS, [*map(_row, changed)])
    if unchanged := [line for line in one.lines if line.outcome == "same"]:
        yield from folded("Unchanged", table(_COLUMNS, [*map(_row, unchanged)]))


def _row(line: ComparisonLine) -> tuple[str, ...]:
    return (OUTCOME_TEXTS[line.outcome], code(metric_text(line)), *map(escaped, numbers(line)))


def numbers(line: ComparisonLine) -> tuple[str, str, str, str]:
    """Base, head, ratio and bounds as text."""
    return (
        show(line.base, line.unit),
        show(line.head, line.unit),
        show(line.ratio, "share", 4),
        interval_text(line.lower, line.upper, "share", 4),
    )


def metric_text(line: ComparisonLine) -> str:
    """The metric with its monitor and rate."""
    name = f"{line.monitor}.{line.metric}" if line.monitor else line.metric
    return f"{name} {at_rate(line.offered_hz)}" if line.offered_hz is not None else name


def title(one: Comparison) -> str:
    """What is compared with what."""
    return f"{one.head.source} compared with {one.base.source}"


def summary(one: Comparison) -> str:
    """The number of metrics by outcome."""
    counts = {outcome: sum(line.outcome == outcome for line in one.lines) for outcome in _ORDER}
    texts = [f"{count} {outcome}" for outcome, count in counts.items() if count]
    return f"{', '.join(texts)}, at {show(one.confidence, 'share')} confidence."
