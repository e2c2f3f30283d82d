"""Pairs on a machine that others use, too: load that both sides had alike opens no verdict.

The promises: at most 5 % wrong, at most 1 % wrong fails that are confirmed, and of what is 15 %
slower at least 95 % found.
"""

from __future__ import annotations

import pytest
from simulated_gates import chance
from simulated_pair_load import LOAD_WORLDS, PairGate

from nightly import noise, sampled, size

pytestmark = pytest.mark.simulation

RUNS = size(5, 200)
WORLDS = sampled(LOAD_WORLDS, 4)
BY_CHANCE = chance(0.05, RUNS)


@pytest.mark.parametrize("name", WORLDS)
def test_what_is_on_the_limit_is_wrong_as_rarely_as_promised(name: str) -> None:
    passed, failed, confirmed = PairGate(LOAD_WORLDS[name], limit=100.0).outcomes(runs=RUNS).shares
    assert passed <= BY_CHANCE
    assert failed <= BY_CHANCE
    assert confirmed <= chance(0.01, RUNS)


@pytest.mark.parametrize("name", WORLDS)
def test_an_unchanged_graph_hardly_fails(name: str) -> None:
    assert PairGate(LOAD_WORLDS[name]).outcomes(runs=RUNS).shares[2] <= 0.01 + noise(0.1)


@pytest.mark.parametrize(("starts", "pairs"), [(0.027, 5), (0.05, 10), (0.1, 40)][: size(2, 3)])
@pytest.mark.parametrize("name", ["idle machine", "a third is taken from both sides"])
def test_what_is_slower_is_found_under_load_that_both_sides_had_alike(
    name: str, starts: float, pairs: int
) -> None:
    gate = PairGate(LOAD_WORLDS[name], slower=1.15, starts=starts, pairs=pairs)
    assert gate.outcomes(runs=RUNS).shares[2] >= 0.95 - noise(0.1)


@pytest.mark.parametrize(("side", "verdict"), [("head", 1), ("base", 0)])
def test_load_on_one_side_alone_decides_nothing(side: str, verdict: int) -> None:
    world = LOAD_WORLDS[f"all runs of the {side}, by bad luck"]
    played, judged = (
        PairGate(world, limit=100.0, interference=policy).outcomes(runs=size(5, 50)).shares[verdict]
        for policy in ("tolerate", "note")
    )
    assert played == 1
    assert judged == 0
