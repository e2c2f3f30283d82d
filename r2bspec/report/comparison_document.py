"""Comparisons of stored results as documents."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import msgspec

from r2bspec.compare.comparison import ADVICE, Comparison, ComparisonLine, Outcome
from r2bspec.diagnostics.plain_text import harmless, plain_values
from r2bspec.judge.measure.units import at_rate, show
from r2bspec.report.document import Block, Cell, Column, Document, Fold, Items, Row, Section, Table
from r2bspec.report.wording import interval_text

OUTCOME_TEXTS: Final[dict[Outcome, str]] = {
    "worse": "▼ worse",
    "can't tell": "? can't tell",
    "improved": "▲ improved",
    "same": "= same",
}
"""Each outcome in words, in the order of a report."""

_COLUMNS: Final = (
    Column("outcome", number=False),
    Column("metric", number=False),
    *map(Column, ("base", "head", "ratio")),
    Column("bounds"),
)


def render(comparisons: Sequence[Comparison], name: str, width: int = 100) -> bytes:
    """Return comparisons as bytes, UTF-8.

    Args:
        comparisons: one for each result that was compared with the base; at least one.
        name: the name of the format, as `r2bspec compare --format` lists them.
        width: the width of lines of text, in columns.
    """
    if name == "json":
        return msgspec.json.format(msgspec.json.encode(list(comparisons)), indent=2) + b"\n"
    document = comparison_document(plain_values(list(comparisons)))
    if name == "markdown":
        from r2bspec.report.markdown import to_markdown

        return harmless(to_markdown(document)).encode()
    from r2bspec.report.terminal import to_text

    return harmless(to_text(document, width=width)).encode()


def comparison_document(comparisons: Sequence[Comparison]) -> Document:
    """Return the report of comparisons with one base: changes first, the rest folded."""
    lines = [line for comparison in comparisons for line in comparison.lines]
    several = len(comparisons) > 1
    blocks = (block for comparison in comparisons for block in _blocks(comparison, titled=several))
    line = _counts(lines)
    if not several:
        line = f"{_title(comparisons[0])}: {line}"
    return Document(
        line=line,
        lead=(f"At {show(comparisons[0].confidence, 'share')} confidence. {ADVICE}",),
        sections=(Section("Comparison", tuple(blocks)),),
    )


def _title(one: Comparison) -> str:
    return f"{one.head.source} compared with {one.base.source}"


def _counts(lines: Sequence[ComparisonLine]) -> str:
    """Return the number of metrics by outcome."""
    counts = {outcome: sum(line.outcome == outcome for line in lines) for outcome in OUTCOME_TEXTS}
    return ", ".join(f"{count} {outcome}" for outcome, count in counts.items() if count)


def _blocks(one: Comparison, *, titled: bool) -> Iterator[Block]:
    if titled or one.differences:
        title = [f"{_title(one)}: {_counts(one.lines)}"] if titled else []
        yield Items((*title, *(f"Difference: {text}" for text in one.differences)))
    order = [*OUTCOME_TEXTS]
    changed = [line for line in one.lines if line.outcome != "same"]
    changed.sort(key=lambda line: order.index(line.outcome))
    if changed:
        yield Table("changed", _COLUMNS, tuple(map(_row, changed)))
    if same := [line for line in one.lines if line.outcome == "same"]:
        yield Fold("Unchanged", (Table("", _COLUMNS, tuple(map(_row, same))),))


def _row(line: ComparisonLine) -> Row:
    name = f"{line.monitor}.{line.metric}" if line.monitor else line.metric
    metric = f"{name} {at_rate(line.offered_hz)}" if line.offered_hz is not None else name
    return Row(
        (
            Cell(OUTCOME_TEXTS[line.outcome]),
            Cell(metric, code=True),
            Cell(show(line.base, line.unit)),
            Cell(show(line.head, line.unit)),
            Cell(show(line.ratio, "share", 4)),
            Cell(interval_text(line.lower, line.upper, "share", 4)),
        )
    )
