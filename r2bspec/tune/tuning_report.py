"""What is said of a search, in the terminal and in Markdown."""

from __future__ import annotations

from collections.abc import Iterator
from operator import attrgetter
from typing import Final

from r2bspec.diagnostics.quote import pluralize
from r2bspec.judge.measure.units import show
from r2bspec.report import markdown
from r2bspec.tune.space import TODAY, changes_text, value_text
from r2bspec.tune.tuning_result import Proof, Trial, TuningResult

HEADER: Final = ("trial", "outcome", "cost", "starts", "values", "why")


def summary(result: TuningResult) -> Iterator[str]:
    """The outcome, the values of the winner, and what its proof shows, a line each."""
    yield f"{result.name}: {result.outcome.upper()}. {result.reason}"
    for path, value in (result.winner or {}).items():
        yield f"  {path}: {value_text(value)}"
    if result.proof is not None and result.proof.ratio is not None:
        yield f"  {result.goal}: {_proof_text(result.proof, result.goal_unit)}"


def _proof_text(proof: Proof, unit: str) -> str:
    def percent(ratio: float | None) -> str:
        return "?" if ratio is None else f"{100 * (ratio - 1):+.3g}"

    values = f"{show(proof.before, unit)} -> {show(proof.after, unit)}"
    interval = f"{percent(proof.lower)} to {percent(proof.upper)} %"
    return f"{values}, {percent(proof.ratio)} % ({interval}) in {pluralize(proof.pairs, 'pair')}"


def trial_rows(result: TuningResult) -> list[tuple[str, ...]]:
    """The cells of every trial, the best first, in the columns of `HEADER`."""
    return [_row(trial, result) for trial in sorted(result.trials, key=attrgetter("rank"))]


def _row(trial: Trial, result: TuningResult) -> tuple[str, ...]:
    worst = min(trial.starts, key=lambda start: start.outcome in {"pass", "inconclusive"})
    return (
        str(trial.number),
        worst.outcome,
        show(trial.cost, result.goal_unit) if trial.cost is not None else "",
        str(len(trial.starts)),
        changes_text(trial.changes, result.values) if trial.changes else TODAY,
        trial.failure or next((start.reason for start in trial.starts if start.reason), ""),
    )


def to_markdown(result: TuningResult) -> str:
    """Return the result as CommonMark with the tables of GitHub and GitLab."""
    first, *others = summary(result)
    lines = [f"### {markdown.escaped(first)}", ""]
    lines += [f"- {markdown.code(line.strip())}" for line in others]
    rows = [tuple(map(markdown.escaped, row)) for row in trial_rows(result)]
    lines += ["", f"Cost: {markdown.escaped(result.goal)}", "", *markdown.table(HEADER, rows)]
    return "\n".join(lines)
