"""The result of a search, as frozen values, and its report in the terminal and in Markdown.

In ``tuning.json`` they are canonical JSON: UTF-8, sorted keys, indentation of two spaces, a newline
at the end.
"""

from __future__ import annotations

from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from typing import Any, Final, Literal

import msgspec

from r2bspec.diagnostics.plain_text import escaped_json
from r2bspec.diagnostics.quote import pluralize
from r2bspec.judge.measure.units import show
from r2bspec.record.files import write_atomically
from r2bspec.report.document import Cell, Column, Document, Row, Section, Table
from r2bspec.tune.space import TODAY, changes_text, value_text

TUNING_FILE: Final = "tuning.json"

StartOutcome = Literal["pass", "fail", "inconclusive", "broken", "refused", "invalid"]
"""The verdict of a start; or ``broken``: the graph did not work; ``refused``: the spec is not valid
with these values, or the system does not permit them, so nothing was started; ``invalid``: the
machine could not play the load, which says nothing of the values."""

TuningOutcome = Literal["improved", "meets", "today", "not met", "not shown", "incomplete"]
"""``improved``: values are proved to meet the objectives at less cost than today's. ``meets``: they
are proved to meet them, and today's do not. ``today``: none seem better than today's. ``not met``:
none meet the objectives. ``not shown``: the pairs do not show it. ``incomplete``: the time was over
before the proof, or the search has not ended."""


class Start(msgspec.Struct, frozen=True, kw_only=True):
    """A start of all processes, with an iteration at each rate.

    Attributes:
        cost: the metric to be least; None where nothing was measured.
        excess: by how much it misses the requirement that it misses most, as the logarithm of the
            ratio to the limit: 0.12 is about 12 %; at most 0 if it meets all.
        reason: which requirement that is, or why nothing was judged; otherwise empty.
        run: the folder of its run below that of the search; empty if there is none.
    """

    outcome: StartOutcome
    cost: float | None = None
    excess: float = 0.0
    reason: str = ""
    run: str = ""


class Trial(msgspec.Struct, frozen=True, kw_only=True):
    """A combination that was tried.

    Attributes:
        number: from 0, which is today's.
        changes: the values that differ from the spec, by path.
        first: its first start.
        race: its further starts.
    """

    number: int
    changes: dict[str, Any]
    first: Start
    race: tuple[Start, ...] = ()

    @property
    def starts(self) -> tuple[Start, ...]:
        """The starts that count: without the first, which chose the combination by luck."""
        return self.race or (self.first,)

    @property
    def failure(self) -> str:
        """Why it cannot be the best: a start does not work, or fails; else empty."""
        for start in self.starts:
            if start.cost is None or start.outcome not in {"pass", "inconclusive"}:
                return start.reason or start.outcome
        return ""

    @property
    def cost(self) -> float | None:
        """The mean cost of its starts; None if it is unknown for any of them."""
        costs = [start.cost for start in self.starts if start.cost is not None]
        return sum(costs) / len(costs) if len(costs) == len(self.starts) else None

    @property
    def excess(self) -> float:
        """The mean excess of its starts."""
        return sum(start.excess for start in self.starts) / len(self.starts)

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """The order of trials: failures come last, then higher costs."""
        if self.failure or self.cost is None:
            return True, self.cost is None, self.excess
        return False, self.excess > 0, self.cost


class Proof(msgspec.Struct, frozen=True, kw_only=True):
    """The evidence of interleaved pairs of new runs, or of runs of the winner alone.

    Attributes:
        run: the folder of the comparison, or of the run, below that of the search.
        meets: whether all requirements are shown to be met.
        gains: whether the pairs show that the cost is less.
        before: the cost of today's values; None without pairs.
        after: that of the winner's.
        ratio: the ratio of after to before, with the bounds of its interval; None where it is
            unknown.
        pairs: the pairs that were used; 0 where today's values do not work, and the winner ran
            alone.
        reason: what is not shown, or why nothing was judged; otherwise empty.
    """

    run: str
    meets: bool = False
    gains: bool = False
    before: float | None = None
    after: float | None = None
    ratio: float | None = None
    lower: float | None = None
    upper: float | None = None
    pairs: int = 0
    reason: str = ""


class TuningResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a search.

    Attributes:
        name: the name of the benchmark.
        goal: the metric to be least, with its rate.
        goal_unit: the unit of the metric.
        values: the values that were listed, by path.
        trials: in their order.
        outcome: what is claimed.
        reason: the same in a sentence.
        winner: the changes that are proved, or were to be; None if there are none.
        proof: the proof of the winner; None if none was made.
        plan: the hash of today's plan.
        machine: on which it ran.
    """

    name: str
    goal: str
    goal_unit: str
    values: dict[str, tuple[Any, ...]]
    trials: tuple[Trial, ...]
    outcome: TuningOutcome
    reason: str
    winner: dict[str, Any] | None = None
    proof: Proof | None = None
    started_at: str = ""
    duration_s: float = 0.0
    plan: str = ""
    machine: dict[str, Any] = {}

    @property
    def is_proved(self) -> bool:
        """Whether the proof shows that the winner is better, or meets the objectives."""
        return self.outcome in {"improved", "meets"}


def to_json(result: TuningResult) -> bytes:
    """Return the canonical JSON of a result."""
    content = msgspec.json.encode(result, order="sorted")
    return escaped_json(msgspec.json.format(content, indent=2) + b"\n")


def write_tuning(folder: Path, result: TuningResult) -> None:
    """Write the result to the folder of its search."""
    write_atomically(folder / TUNING_FILE, to_json(result))


_COLUMNS: Final = (
    Column("trial", number=False),
    Column("outcome", number=False),
    Column("cost"),
    Column("starts"),
    Column("values", number=False),
    Column("why", number=False),
)


def tuning_document(result: TuningResult) -> Document:
    """Return the report of a search: the winner, its proof, and every trial, the best first."""
    rows = tuple(_row(trial, result) for trial in sorted(result.trials, key=attrgetter("rank")))
    return Document(
        line=f"{result.name}: {result.outcome.upper()}. {result.reason}",
        lead=tuple(_winner(result)),
        sections=(Section("Trials", (Table("trials", _COLUMNS, rows, f"cost: {result.goal}"),)),),
    )


def _winner(result: TuningResult) -> Iterator[str]:
    for path, value in (result.winner or {}).items():
        yield f"{path}: {value_text(value)}"
    if result.proof is not None and result.proof.ratio is not None:
        yield f"{result.goal}: {_proof_text(result.proof, result.goal_unit)}"


def _proof_text(proof: Proof, unit: str) -> str:
    def percent(ratio: float | None) -> str:
        return "?" if ratio is None else f"{100 * (ratio - 1):+.3g}"

    values = f"{show(proof.before, unit)} -> {show(proof.after, unit)}"
    interval = f"{percent(proof.lower)} to {percent(proof.upper)} %"
    return f"{values}, {percent(proof.ratio)} % ({interval}) in {pluralize(proof.pairs, 'pair')}"


def _row(trial: Trial, result: TuningResult) -> Row:
    worst = min(trial.starts, key=lambda start: start.outcome in {"pass", "inconclusive"})
    texts = (
        str(trial.number),
        worst.outcome,
        show(trial.cost, result.goal_unit) if trial.cost is not None else "",
        str(len(trial.starts)),
        changes_text(trial.changes, result.values) if trial.changes else TODAY,
        trial.failure or next((start.reason for start in trial.starts if start.reason), ""),
    )
    return Row(tuple(map(Cell, texts)))
