"""Searches for a deployment in graphs of which the best one is known."""

from __future__ import annotations

from functools import cache
from statistics import median

import pytest
from simulated_deployments import SETTINGS, SimulatedGraph, blank, trials_needed

from nightly import noise, size
from r2bspec.plan.tuning_space import Deployment
from r2bspec.tune.search import Search
from r2bspec.tune.tuning_result import TuningResult

pytestmark = pytest.mark.simulation

GRAPHS = size(16, 200)


@cache
def searched(seed: int) -> tuple[SimulatedGraph, TuningResult]:
    graph = SimulatedGraph.drawn(seed)
    return graph, Search(blank(graph.space), graph, SETTINGS).run()


def winners() -> list[tuple[SimulatedGraph, Deployment]]:
    found = [searched(seed) for seed in range(GRAPHS)]
    return [(graph, result.winner) for graph, result in found if result.winner is not None]


def test_nine_of_ten_searches_end_with_a_deployment_that_meets_the_objectives() -> None:
    meeting = [
        graph.works(winner) and graph.true_excess(winner) <= 0 for graph, winner in winners()
    ]
    assert sum(meeting) >= (0.9 - noise(0.05)) * GRAPHS


def test_most_winners_cost_little_more_than_the_best() -> None:
    near = [graph.true_cost(winner) < 1.05 * graph.best_cost() for graph, winner in winners()]
    assert sum(near) >= (0.85 - noise(0.15)) * GRAPHS


def test_levers_that_give_nothing_are_not_in_the_winner() -> None:
    kept = idle = 0
    for graph, winner in winners():
        for choice in winner.choices if len(winner.choices) > 1 else ():
            others = {each.lever: each.place for each in winner.choices if each != choice}
            without = graph.space.deployment(others)
            kept += 1
            idle += (
                graph.true_cost(without) <= graph.true_cost(winner)
                and graph.true_excess(without) <= 0
            )
    assert kept >= GRAPHS
    assert idle <= (0.05 + noise(0.05)) * kept


def test_a_claim_is_hardly_ever_wrong() -> None:
    wrong = 0
    for seed in range(GRAPHS):
        graph, result = searched(seed)
        if result.outcome == "improved" and result.winner is not None:
            wrong += graph.true_cost(result.winner) >= graph.true_cost(graph.space.today())
        if result.outcome in {"improved", "meets"} and result.winner is not None:
            wrong += graph.true_excess(result.winner) > 0
    assert wrong <= (0.05 + noise(0.05)) * GRAPHS


def test_no_search_takes_longer_than_its_budget() -> None:
    assert all(searched(seed)[0].clock_s <= SETTINGS.budget_s for seed in range(GRAPHS))


@pytest.mark.parametrize("seed", range(4))
def test_noise_alone_is_not_claimed_to_be_a_gain(seed: int) -> None:
    graph = SimulatedGraph.drawn(2 * seed, noise=0.1)
    graph.cost = dict.fromkeys(graph.cost, 0.0)
    graph.together = {}
    graph.latency = dict.fromkeys(graph.latency, 0.0)
    result = Search(blank(graph.space), graph, SETTINGS).run()
    assert result.outcome in {"met today", "not shown"}


def test_as_good_a_deployment_takes_half_the_trials_of_chance_and_of_a_grid() -> None:
    needed = [each for seed in range(GRAPHS) if (each := trials_needed(seed))]
    search, chance, grid = (
        median(each[name] for each in needed) for name in ("search", "chance", "grid")
    )
    assert search <= (0.5 + noise(0.1)) * chance
    assert search <= 0.5 * grid
