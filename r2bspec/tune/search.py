"""The search for the combination that meets the objectives at the least cost, and its proof.

1. *Trials*: `Proposals` says what to try, one start of all processes measures it.
2. *Race*: the best of many trials were lucky, too. The best four are started again, twice, then the
   best two of them, twice. A start whose verdict is FAIL ends the race of its combination. The
   first starts do not count: they chose the four.
3. *Proof*: the best is compared with today's values in interleaved pairs, each run a new start,
   none of them seen before. The claim is what these pairs show. Where today's values do not work,
   there is nothing to compare with, and runs of the winner alone decide.

So a search that believed noise ends with a claim that is not shown, and not with a wrong one: the
chance that the proof shows a gain where there is none is that of the pairs, 5 %
(`r2bspec.judge.statistics.t_interval`).
"""

from __future__ import annotations

import random
from collections.abc import Callable
from operator import attrgetter
from typing import Final, NamedTuple, Protocol

from msgspec.structs import replace

from r2bspec.diagnostics.quote import pluralize
from r2bspec.judge.measure.units import show
from r2bspec.tune.space import TODAY, Combination, Proposals, Space, changes_text
from r2bspec.tune.tuning_result import Proof, Start, Trial, TuningOutcome

_RACE: Final = (4, 4, 2, 2)
"""How many combinations are started in each round of the race."""

_FEWEST_PAIRS: Final = 3
"""Pairs that can show anything: the first look is at three."""


class SearchLimits(NamedTuple):
    """How long a search may take.

    Attributes:
        trials: the most combinations that are started.
        budget_s: the time of the whole search, proof included.
        pairs: the most pairs of the proof.
    """

    trials: int
    budget_s: float
    pairs: int


class Machine(Protocol):
    """The machine that starts combinations."""

    def now(self) -> float:
        """Return the seconds since any moment."""

    def start(self, combination: Combination, name: str) -> Start:
        """Start all processes once, play an iteration at each rate, and judge it."""

    def prove(
        self, base: Combination | None, winner: Combination, pairs: int, limit_s: float
    ) -> Proof:
        """Play at most `pairs` pairs of base and winner, or the winner alone without a base.

        No pair begins that would end after `limit_s`.
        """


class Found(NamedTuple):
    """The claim of a search; see `TuningResult`."""

    outcome: TuningOutcome
    reason: str
    winner: Combination | None = None
    proof: Proof | None = None


class Search:
    """A search.

    Args:
        space: the space of all combinations.
        machine: where they are started.
        limits: how long it may take.
        tell: is called with a line for the user after each step.

    Attributes:
        trials: so far.
    """

    def __init__(
        self,
        space: Space,
        machine: Machine,
        limits: SearchLimits,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._space, self._machine, self._limits, self._tell = space, machine, limits, tell
        self.trials: list[Trial] = []
        self._combinations: list[Combination] = []
        self._began_s = machine.now()
        self._longest_s = 0.0

    def run(self) -> Found:
        """Try, race and prove."""
        self._try_all()
        ranked = self._race()
        best = ranked[0]
        if best.failure:
            return self._none_meets(best)
        today = self.trials[0]
        if best.number == 0:
            others = pluralize(len(self.trials) - 1, "other combination")
            return Found("today", f"None of {others} seems better than today's values.")
        winner = self._combinations[best.number]
        pairs = min(self._limits.pairs, int(self._left_s() / (2 * self._longest_s)))
        if pairs < _FEWEST_PAIRS:
            reason = "The time ran out before the proof: give a larger budget."
            return Found("incomplete", reason, winner)
        self._tell(f"proof of {self._text(best)}")
        base = None if today.first.outcome == "broken" else self._space.today
        proof = self._machine.prove(base, winner, pairs, self._left_s())
        return self._claim(winner, proof, today)

    def _try_all(self) -> None:
        """Try today's combination and others, while there is time for the proof."""
        proposals = Proposals(self._space, self._limits.trials)
        combination: Combination | None = self._space.today
        started = 0
        while combination is not None and started < self._limits.trials and self._has_time():
            trial = self._try(combination)
            started += trial.first.outcome != "refused"
            proposals.tell(combination, trial.first.cost, trial.first.excess)
            combination = proposals.next()

    def _try(self, combination: Combination) -> Trial:
        number = len(self.trials)
        first = self._start(combination, f"{number:03d}")
        changes = self._space.changes(combination)
        self._combinations.append(combination)
        self.trials.append(Trial(number=number, changes=changes, first=first))
        cost = f" {first.cost:.4g}" if first.cost is not None else ""
        self._tell(f"trial {number}, {self._text(self.trials[-1])}: {first.outcome}{cost}")
        return self.trials[-1]

    def _race(self) -> list[Trial]:
        """Start the best again; return the trials in their order, those that raced first."""
        chance = random.Random(0)  # noqa: S311 - an order, not a secret
        racing = sorted(self.trials, key=attrgetter("rank"))
        for number, size in enumerate(_RACE, start=1):
            racing = [trial for trial in racing if not trial.failure][:size]
            needed_s = (len(racing) + 2 * _FEWEST_PAIRS) * self._longest_s
            if len(racing) < 2 or self._left_s() < needed_s:
                break
            for trial in chance.sample(racing, len(racing)):
                combination = self._combinations[trial.number]
                start = self._start(combination, f"race-{number}-{trial.number:03d}")
                raced = replace(trial, race=(*trial.race, start))
                self.trials[trial.number] = raced
            racing = sorted((self.trials[trial.number] for trial in racing), key=attrgetter("rank"))
            order = ", ".join(str(trial.number) for trial in racing)
            self._tell(f"race, round {number} of {len(_RACE)}: trials {order}")
        return racing or sorted(self.trials, key=attrgetter("rank"))

    def _start(self, combination: Combination, name: str) -> Start:
        began_s = self._machine.now()
        start = self._machine.start(combination, name)
        self._longest_s = max(self._longest_s, self._machine.now() - began_s)
        return start

    def _none_meets(self, nearest: Trial) -> Found:
        why = f"{self._text(nearest)}: {nearest.failure}"
        if all(trial.first.outcome in {"refused", "invalid"} for trial in self.trials):
            return Found("incomplete", f"No start could be judged; {why}")
        count = pluralize(len(self.trials), "combination")
        return Found("not met", f"None of {count} meets the objectives; the nearest is {why}")

    def _claim(self, winner: Combination, proof: Proof, today: Trial) -> Found:
        """Return what the proof shows."""
        if not proof.meets:
            return Found("not shown", proof.reason, winner, proof)
        if proof.gains and proof.ratio is not None:
            gain = f"{show(1 - proof.ratio, 'share')} less cost than today's"
            return Found("improved", f"The objectives are met, at {gain}.", winner, proof)
        if today.first.outcome in {"fail", "broken"}:
            reason = "The objectives are met; today's values missed them when they were tried."
            return Found("meets", reason, winner, proof)
        return Found("not shown", "The pairs do not show that it costs less.", winner, proof)

    def _has_time(self) -> bool:
        """Return whether there is time for a trial beside what is kept for race and proof."""
        runs = sum(_RACE) + 2 * self._limits.pairs
        kept_s = min(self._limits.budget_s / 2, runs * self._longest_s)
        return self._left_s() >= kept_s + self._longest_s

    def _left_s(self) -> float:
        return self._limits.budget_s - (self._machine.now() - self._began_s)

    def _text(self, trial: Trial) -> str:
        return changes_text(trial.changes, self._space.values) if trial.changes else TODAY
