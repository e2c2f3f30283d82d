"""A comparison as text, Markdown or JSON."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence

import msgspec

from r2bspec.compare.comparison import ADVICE, Comparison, ComparisonLine, Outcome
from r2bspec.measure.units import at_rate, show
from r2bspec.report.formats.markdown import code, escaped, folded, table
from r2bspec.report.output import console

OUTCOME_TEXTS: dict[Outcome, str] = {
    "improved": "▲ improved",
    "worse": "▼ worse",
    "same": "= same",
    "can't tell": "? can't tell",
}

_ORDER: tuple[Outcome, ...] = ("worse", "can't tell", "improved", "same")


def to_json(comparisons: Sequence[Comparison]) -> bytes:
    """A list with one object for each result that was compared with the base."""
    return msgspec.json.format(msgspec.json.encode(list(comparisons)), indent=2) + b"\n"


def to_text(comparisons: Sequence[Comparison], width: int = 100) -> str:
    """A table for each, its lines in the order of rates and metrics."""
    from rich.text import Text

    from r2bspec.report.terminal.style import DIM_STYLE, heading
    from r2bspec.report.terminal.style import table as frame

    buffer = io.StringIO()
    page = console(buffer, width=max(width, 60), color_system=None, legacy_windows=False)
    for one in comparisons:
        page.print(heading(title(one), ""))
        for difference in one.differences:
            page.print(f"  ! {difference}", markup=False, highlight=False)
        made = frame(["", "metric", "base", "head", "ratio", "bounds"])
        # Where there is little room, these two are folded, and outcomes and values stay whole.
        for column in (made.columns[1], made.columns[-1]):
            column.no_wrap, column.overflow = False, "fold"
        for line in one.lines:
            cells = (metric_text(line), *numbers(line))
            made.add_row(Text(OUTCOME_TEXTS[line.outcome]), *map(Text, cells))
        page.print(made)
        page.print(summary(one), highlight=False)
        page.print()
    page.print(Text(ADVICE, style=DIM_STYLE))
    return "".join(f"{line.rstrip()}\n" for line in buffer.getvalue().splitlines())


def to_markdown(comparisons: Sequence[Comparison]) -> str:
    """What has changed visible, the rest folded."""
    return "\n".join(line for one in comparisons for line in _markdown(one)) + f"\n{ADVICE}\n"


def _markdown(one: Comparison) -> Iterator[str]:
    yield f"### {escaped(title(one))}"
    yield ""
    yield escaped(summary(one))
    yield ""
    yield from (f"> Difference: {escaped(each)}  " for each in one.differences)
    yield ""
    header = ("", "metric", "base", "head", "ratio", "bounds")
    rows = {
        True: [line for line in one.lines if line.outcome != "same"],
        False: [line for line in one.lines if line.outcome == "same"],
    }
    if rows[True]:
        ordered = sorted(rows[True], key=lambda line: _ORDER.index(line.outcome))
        yield from table(header, [_row(line) for line in ordered])
    if rows[False]:
        yield from folded("Unchanged", table(header, [_row(line) for line in rows[False]]))


def _row(line: ComparisonLine) -> tuple[str, ...]:
    return (OUTCOME_TEXTS[line.outcome], code(metric_text(line)), *map(escaped, numbers(line)))


def numbers(line: ComparisonLine) -> tuple[str, str, str, str]:
    """Base, head, ratio and bounds as text."""
    return (
        show(line.base, line.unit),
        show(line.head, line.unit),
        show(line.ratio, "share", 4),
        _bounds(line),
    )


def _bounds(line: ComparisonLine) -> str:
    if line.lower is None and line.upper is None:
        return ""
    if line.lower is None:
        return f"≤ {show(line.upper, 'share', 4)}"
    if line.upper is None:
        return f"≥ {show(line.lower, 'share', 4)}"
    return f"{show(line.lower, 'share', 4)} … {show(line.upper, 'share', 4)}"


def metric_text(line: ComparisonLine) -> str:
    """The metric with its monitor and rate."""
    name = f"{line.monitor}.{line.metric}" if line.monitor else line.metric
    return f"{name} {at_rate(line.offered_hz)}" if line.offered_hz is not None else name


def title(one: Comparison) -> str:
    """What is compared with what."""
    return f"{one.head.source} compared with {one.base.source}"


def summary(one: Comparison) -> str:
    """The number of metrics by outcome."""
    counts = {each: sum(line.outcome == each for line in one.lines) for each in _ORDER}
    texts = [f"{count} {outcome}" for outcome, count in counts.items() if count]
    return f"{', '.join(texts)}, at {show(one.confidence, 'share')} confidence."
