"""What a search tries, races and claims, on a machine whose every answer is given."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from r2bspec.tune.search import Found, Search, SearchLimits
from r2bspec.tune.space import Combination, Proposals, Space
from r2bspec.tune.tuning_result import Proof, Start, StartOutcome

SPACE = Space({"graph.a": (1, 2), "graph.b": (1,), "graph.c": (1,)})
ALL = set(itertools.product(*map(range, SPACE.sizes)))
PROVED = Proof(run="proof", meets=True, gains=True, ratio=0.8, pairs=8)


def passed(cost: float) -> Start:
    return Start(outcome="pass", cost=cost)


def missed(excess: float) -> Start:
    return Start(outcome="fail", cost=1.0, excess=excess, reason=f"p99 by {excess}")


def cheaper_by_changes(combination: Combination) -> Start:
    return passed(1.0 - 0.1 * sum(map(bool, combination)))


@dataclass
class GivenMachine:
    """A machine whose starts take ten seconds."""

    answer: Callable[[Combination], Start]
    proof: Proof = PROVED
    seconds: float = 0.0
    names: list[str] = field(default_factory=list)
    proved: list[tuple[Combination | None, Combination, int]] = field(default_factory=list)

    def now(self) -> float:
        return self.seconds

    def start(self, combination: Combination, name: str) -> Start:
        self.seconds += 10
        self.names.append(name)
        return self.answer(combination)

    def prove(
        self, base: Combination | None, winner: Combination, pairs: int, limit_s: float
    ) -> Proof:
        self.seconds += 20 * pairs
        assert 20 * pairs <= limit_s
        self.proved.append((base, winner, pairs))
        return self.proof


def search(
    machine: GivenMachine, trials: int = 12, budget_s: float = 1200.0
) -> tuple[Found, Search]:
    searching = Search(SPACE, machine, SearchLimits(trials, budget_s, pairs=8))
    return searching.run(), searching


def test_every_combination_is_proposed_once_and_single_values_first() -> None:
    proposals = Proposals(SPACE, trials=30)
    proposals.tell(SPACE.today, 1.0, -0.5)
    seen = []
    while (combination := proposals.next()) is not None:
        seen.append(combination)
        proposals.tell(combination, None if combination[1] else 1.0, 0.0)
    assert seen[:4] == SPACE.single_changes()
    assert len(seen) == len(ALL) - 1
    assert {*seen, SPACE.today} == ALL


def test_the_cheapest_combination_races_and_is_proved_against_todays() -> None:
    machine = GivenMachine(cheaper_by_changes)
    found, searched = search(machine)
    assert found.outcome == "improved"
    assert found.reason == "The objectives are met, at 20 % less cost than today's."
    assert found.winner is not None
    assert all(found.winner)
    assert machine.proved == [(SPACE.today, found.winner, 8)]
    assert sum(name.startswith("race") for name in machine.names) == 4 + 4 + 2 + 2
    # The first start of a trial does not count once it has raced.
    raced = [trial for trial in searched.trials if trial.race]
    assert all(trial.starts == trial.race for trial in raced)


def test_a_fail_in_the_race_ends_it_for_a_combination() -> None:
    unlucky = (1, 1, 1)

    def answer(combination: Combination) -> Start:
        again = combination == unlucky and machine.names[-1].startswith("race")
        return missed(0.1) if again else cheaper_by_changes(combination)

    machine = GivenMachine(answer)
    found, _ = search(machine)
    assert found.winner == (2, 1, 1)


@pytest.mark.parametrize(
    ("proof", "today", "outcome"),
    [
        (PROVED, "pass", "improved"),
        (Proof(run="proof", meets=True, ratio=1.0, pairs=8), "pass", "not shown"),
        (Proof(run="proof", meets=True, ratio=1.0, pairs=8), "inconclusive", "not shown"),
        (Proof(run="proof", meets=True, ratio=1.2, pairs=8), "fail", "meets"),
        (Proof(run="proof", meets=False, gains=True, ratio=0.8, pairs=8), "pass", "not shown"),
    ],
)
def test_what_pairs_show_is_claimed(proof: Proof, today: StartOutcome, outcome: str) -> None:
    def answer(combination: Combination) -> Start:
        if combination == SPACE.today:
            return Start(outcome=today, cost=1.0)
        return cheaper_by_changes(combination)

    found, _ = search(GivenMachine(answer, proof))
    assert found.outcome == outcome
    assert found.proof == proof


def test_where_todays_values_do_not_work_the_winner_runs_alone() -> None:
    def answer(combination: Combination) -> Start:
        return passed(1.0) if combination[0] else Start(outcome="broken", reason="R2B640")

    machine = GivenMachine(answer, Proof(run="proof", meets=True))
    found, _ = search(machine)
    assert found.outcome == "meets"
    assert machine.proved[0][0] is None


def test_todays_values_stay_where_no_others_seem_better() -> None:
    machine = GivenMachine(lambda one: passed(1.0 + sum(one)))
    found, _ = search(machine)
    assert (found.outcome, found.winner, machine.proved) == ("today", None, [])


def test_the_nearest_combination_is_named_where_none_meets_the_objectives() -> None:
    found, _ = search(GivenMachine(lambda one: missed(0.5 - 0.1 * sum(one))))
    assert found.outcome == "not met"
    assert found.reason.startswith("None of 12 combinations meets the objectives; the nearest is")
    assert "a 2, b 1, c 1: p99 by" in found.reason


@pytest.mark.parametrize("outcome", ["refused", "invalid"])
def test_starts_that_say_nothing_show_nothing(outcome: StartOutcome) -> None:
    found, searched = search(GivenMachine(lambda _: Start(outcome=outcome, reason="why")), 3)
    assert found.outcome == "incomplete"
    assert "why" in found.reason
    # What is refused was not started, and does not count.
    assert len(searched.trials) == (12 if outcome == "refused" else 3)


@pytest.mark.parametrize("budget_s", [15.0, 100.0, 300.0, 700.0])
def test_no_search_takes_longer_than_its_budget(budget_s: float) -> None:
    machine = GivenMachine(cheaper_by_changes)
    found, _ = search(machine, trials=100, budget_s=budget_s)
    assert machine.seconds <= budget_s
    assert found.outcome in {"improved", "incomplete", "today"}


def test_a_value_without_a_cost_is_not_the_best() -> None:
    def answer(combination: Combination) -> Start:
        unknown = Start(outcome="pass", reason="no value")
        return unknown if combination[0] else cheaper_by_changes(combination)

    found, _ = search(GivenMachine(answer))
    assert found.winner is not None
    assert not found.winner[0]
