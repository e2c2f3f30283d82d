"""The style of outcomes, and the layout of all tables of the report."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from r2bspec.judge.verdict import OverallOutcome, RequirementVerdict
from r2bspec.report.report_wording import OUTCOME_WORDS, verdict_word

_STYLES: dict[OverallOutcome, str] = {
    "pass": "bold green",
    "fail": "bold red",
    "inconclusive": "bold yellow",
    "invalid": "bold magenta",
    "incomplete": "bold magenta",
}

DIM_STYLE = "dim"


def outcome_text(outcome: OverallOutcome) -> Text:
    """An outcome as a word with its mark and colour."""
    return Text(OUTCOME_WORDS[outcome], style=_STYLES[outcome])


def verdict_text(one: RequirementVerdict) -> Text:
    """The same for a requirement, with its level."""
    return Text(verdict_word(one), style=_STYLES[one.outcome])


def heading(text: str, aside: str = "") -> Text:
    """A section's heading, with a dimmed aside."""
    return Text.assemble((text, "bold"), (f"  {aside}" if aside else "", DIM_STYLE))


def table(columns: Sequence[str]) -> Table:
    """A table whose first column is a name and whose others are numbers."""
    made = Table(
        box=None,
        pad_edge=False,
        padding=(0, 2, 0, 0),
        header_style=DIM_STYLE,
    )
    for number, name in enumerate(columns):
        made.add_column(name, justify="left" if number == 0 else "right", no_wrap=True)
    return made
