"""The result of a search in the terminal: the outcome, what is proposed, its proof, all trials."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from rich.table import Table
from rich.text import Text

from r2bspec.report.output import MAX_TABLE_ROWS
from r2bspec.report.terminal_tables import DIM_STYLE, heading
from r2bspec.tune import tuning_texts as wording
from r2bspec.tune.tuning_result import TUNING_FILE, TrialState, TuningOutcome, TuningResult

if TYPE_CHECKING:
    from rich.console import Console

_OUTCOME_STYLES: Final[dict[TuningOutcome, str]] = {
    "improved": "bold green",
    "meets": "bold green",
    "met today": "bold",
    "not met": "bold red",
    "not shown": "bold yellow",
    "incomplete": "bold magenta",
}
_STATE_STYLES: Final[dict[TrialState, str]] = {
    "meets": "green",
    "misses": "red",
    "open": "yellow",
    "broken": "magenta",
    "refused": DIM_STYLE,
    "invalid": DIM_STYLE,
}


def print_tuning(result: TuningResult, page: Console) -> None:
    """Print a result to a console, with its width and colours."""
    page.print(Text(wording.headline(result), style=_OUTCOME_STYLES[result.outcome]))
    page.print(Text(wording.facts(result), style=DIM_STYLE))
    page.print()
    winner = list(wording.winner_lines(result))
    if winner:
        page.print(heading(wording.winner_title(result), result.name))
        for line in winner:
            page.print(Text(f"  {line}"))
        page.print()
    for title, aside, rows, notes in wording.gain_tables(result):
        page.print(heading(title, aside))
        grid = _table(wording.gain_header(result), right=(1, 2, 3, 4, 5))
        for row in rows:
            grid.add_row(*map(Text, row))
        page.print(grid)
        for note in notes:
            page.print(Text(note))
        page.print()
    _print_trials(page, result)
    for title, sentences in wording.remarks(result):
        page.print(heading(title))
        for sentence in sentences:
            page.print(Text(f"  {sentence}"))
        page.print()


def _print_trials(page: Console, result: TuningResult) -> None:
    rows = wording.trial_rows(result)
    if not rows:
        return
    page.print(heading("Trials", f"the best first; the cost is {result.goal}"))
    grid = _table(("", "outcome", "cost", "deployment", "why"), right=(0, 2))
    for row in rows[:MAX_TABLE_ROWS]:
        word = Text(row.word, style=_STATE_STYLES[row.state])
        why = "; ".join(filter(None, (row.margin, row.reason)))
        grid.add_row(Text(row.number), word, Text(row.cost), Text(row.deployment), Text(why))
    page.print(grid)
    if len(rows) > MAX_TABLE_ROWS:
        left_out = f"({len(rows) - MAX_TABLE_ROWS:,} more: {TUNING_FILE} has all)"
        page.print(Text(left_out, style=DIM_STYLE))
    page.print()


def _table(columns: Sequence[str], right: Sequence[int]) -> Table:
    """A table whose texts wrap, and whose numbers do not."""
    grid = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style=DIM_STYLE)
    for number, name in enumerate(columns):
        is_number = number in right
        justify = "right" if is_number else "left"
        grid.add_column(Text(name), justify=justify, no_wrap=is_number, overflow="fold")  # type: ignore[arg-type]
    return grid
