"""Searches among values of which the best combination is known."""

from __future__ import annotations

from functools import cache

import pytest
from simulated_deployments import LIMITS, SimulatedGraph

from nightly import noise, size
from r2bspec.tune.search import Found, Search

pytestmark = pytest.mark.simulation

GRAPHS = size(20, 200)


@cache
def searched(seed: int) -> tuple[SimulatedGraph, Found]:
    graph = SimulatedGraph.drawn(seed)
    return graph, Search(graph.space, graph, LIMITS).run()


def test_most_winners_are_near_the_best_and_keep_the_limit() -> None:
    good = 0
    for seed in range(GRAPHS):
        graph, found = searched(seed)
        if found.winner is not None and found.outcome in {"improved", "meets"}:
            near = graph.true_cost(found.winner) < 1.1 * graph.best_cost()
            good += near and graph.keeps(found.winner)
    assert good >= (0.75 - noise(0.15)) * GRAPHS


def test_a_claim_is_hardly_ever_wrong() -> None:
    wrong = 0
    for seed in range(GRAPHS):
        graph, found = searched(seed)
        if found.winner is None or found.outcome not in {"improved", "meets"}:
            continue
        gains = graph.true_cost(found.winner) < graph.true_cost(graph.space.today)
        wrong += not graph.keeps(found.winner) or (found.outcome == "improved" and not gains)
    assert wrong <= (0.05 + noise(0.05)) * GRAPHS


def test_noise_alone_is_not_claimed_to_be_a_gain() -> None:
    claimed = 0
    for seed in range(GRAPHS):
        graph = SimulatedGraph.without_effects(seed)
        found = Search(graph.space, graph, LIMITS).run()
        claimed += found.outcome in {"improved", "meets"}
    assert claimed <= (0.05 + noise(0.05)) * GRAPHS


def test_no_search_takes_longer_than_its_budget() -> None:
    assert all(searched(seed)[0].clock_s <= LIMITS.budget_s for seed in range(GRAPHS))
