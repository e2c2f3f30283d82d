"""Runs of several starts in a world of worlds: wrong passes, wrong fails, and confirmed ones.

Promise: at most 5 % of runs pass wrongly, at most 5 % fail wrongly, and at most 1 % fail wrongly
and are confirmed. Of 400 runs a share of 5 % comes to at most 8.3 % with three standard errors of
bad luck; a test that is wrong in 13 % would be noticed in 99.9 of 100 cases. What no test can hold
is listed with the largest figure it may reach, and why.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated_caveats import caveats
from simulated_gates import RUN_WORLDS, chance, held, pairs_errors
from simulated_starts import (
    DEFAULT,
    QUANTITIES,
    WINDOWS,
    WORLDS,
    Shape,
    StartWorld,
    errors,
    has_room,
    limit_of,
    outcome,
    stored_errors,
    time_to_verdict,
    verdict_on,
)

from nightly import noise, sampled, size
from r2bspec.plan.interim_looks import InterimLooks

pytestmark = pytest.mark.simulation

RUNS = size(40, 400)
COMPARISONS = size(100, 1000)
NOISE = noise(0.2)
"""What a small sample adds to the largest figures below."""

NO_RUN_KNOWS = ""
"""Nothing in the run tells it; what is the same for every run is in docs/verdicts.md."""

CLOSE = "met by at least"
BURSTS = "burst"
STALLS = "would break the limit"
STARTS = "differ by"

# Of 10 iterations none is one of the slow tenth in 35 % of runs, of 5 starts none of the slow
# fifth in 33 %.
UNSEEN = {
    **dict.fromkeys(QUANTITIES, (0.42, CLOSE)),
    "drop rate 1 %": (0.42, NO_RUN_KNOWS),
}

NOT_HELD: dict[str, dict[str, tuple[float, str]]] = {
    "messages resemble (0.99)": {"p99": (0.13, BURSTS), "drop rate 1 %": (0.32, BURSTS)},
    "iterations resemble (0.5), 5 %": {
        "p99": (0.11, CLOSE),
        "drop rate 1 %": (0.14, NO_RUN_KNOWS),
    },
    "iterations resemble (0.8), 5 %": {
        "p50": (0.15, CLOSE),
        "p99": (0.19, CLOSE),
        "drop rate 1 %": (0.25, NO_RUN_KNOWS),
        "mean, throughput": (0.16, CLOSE),
    },
    "starts resemble (0.5), 2.7 %": {
        "p99": (0.10, CLOSE),
        "drop rate 1 %": (0.14, NO_RUN_KNOWS),
    },
    "starts differ by 5 %": {"drop rate 1 %": (0.10, NO_RUN_KNOWS)},
    "starts differ by 10 %": {"drop rate 1 %": (0.26, STARTS)},
    "a stop of 0.5 s every 30 s": {"mean, throughput": (0.2, STALLS)},
    "stalls of 20 messages": {
        "p99": (0.10, BURSTS),
        "drop rate 1 %": (0.11, BURSTS),
        "mean, throughput": (0.19, STALLS),
    },
    "stalls of 40 messages": {
        "p99": (0.28, BURSTS),
        "drop rate 1 %": (0.28, BURSTS),
        "mean, throughput": (0.34, STALLS),
    },
    "1 iteration in 10 is slow": UNSEEN,
    "1 start in 5 is slow": UNSEEN,
    "the hour differs by 2.7 %": {
        **dict.fromkeys(QUANTITIES, (0.5, CLOSE)),
        "drop rate 1 %": (0.5, NO_RUN_KNOWS),
    },
}
"""The largest share of wrong passes, by world and quantity, and the words that a wrong verdict has
in its limits or in a note, if the run gives reason for them."""

MEMORY = "iterations resemble (0.8), 5 %"


@pytest.mark.parametrize("name", sampled(WORLDS, 2))
def test_errors_on_the_limit(name: str) -> None:
    for quantity, found in errors(WORLDS[name], runs=RUNS, looks=True).items():
        passed, failed, confirmed = found.shares
        most_passed, _ = NOT_HELD.get(name, {}).get(quantity, (chance(0.05, RUNS), ""))
        assert passed <= most_passed + NOISE, quantity
        if name == "the hour differs by 2.7 %":
            continue
        most = 0.16 + NOISE if name == MEMORY else chance(0.05, RUNS)
        assert failed <= most, quantity
        assert confirmed <= chance(0.01, RUNS), quantity


@pytest.mark.parametrize(
    ("name", "quantity"),
    sampled(
        [(name, one) for name in NOT_HELD for one, (_, words) in NOT_HELD[name].items() if words], 3
    ),
)
def test_where_no_test_holds_the_verdict_says_so(name: str, quantity: str) -> None:
    """The runs that the simulation judges wrongly are judged again, from their messages."""
    world, (_, words), wanted = WORLDS[name], NOT_HELD[name][quantity], size(4, 40)
    told = caveats(world, quantity, limit_of(world, quantity), 1, wanted=wanted)
    assert len(told) == wanted
    assert sum(words in text for text in told) >= 0.9 * wanted - noise(1)


@pytest.mark.parametrize("quantity", ["p50", "p99", "mean, throughput"])
def test_a_failure_that_another_hour_would_not_have_says_so(quantity: str) -> None:
    world, wanted = WORLDS["the hour differs by 2.7 %"], size(4, 40)
    told = caveats(world, quantity, limit_of(world, quantity), -1, wanted=wanted)
    assert len(told) == wanted
    assert sum("another hour" in text for text in told) >= 0.95 * wanted - noise(1)


@pytest.mark.parametrize("quantity", ["p50", "mean, throughput"])
def test_a_latency_that_is_met_by_a_fifth_has_room(quantity: str) -> None:
    world, wanted = WORLDS["starts differ by 2.7 %"], size(10, 100)
    told = caveats(world, quantity, 1.2 * limit_of(world, quantity), 1, wanted=wanted)
    assert sum(CLOSE in text for text in told) <= 0.1 * len(told)


@pytest.mark.parametrize(
    "name", ["nothing differs", "starts differ by 1 %", "stalls of 5 messages"]
)
def test_what_is_met_clearly_is_met_without_a_word(name: str) -> None:
    """A caveat that right verdicts have, too, tells nothing: here they have half to spare."""
    world, random = WORLDS[name], np.random.default_rng(6)
    told: list[bool] = []
    for _ in range(size(10, 100)):
        values = world.run(random, DEFAULT)
        for quantity, limit in (
            ("mean, throughput", 1.5 * world.mean),
            ("drop rate 1 %", world.quantile(0.999) * 1.25),
        ):
            verdict = verdict_on(values, quantity, limit)
            assert verdict.outcome == "pass"
            told.append(bool(verdict.requirements[0].notes))
    assert sum(told) <= 0.1 * len(told)


@pytest.mark.parametrize("shape", [Shape(2, 2, 750), Shape(3, 2, 500), Shape(10, 2, 150)])
@pytest.mark.parametrize("name", ["starts differ by 2.7 %", "both differ by 2.7 %"])
def test_starts_of_any_number_above_one(name: str, shape: Shape) -> None:
    for found in errors(WORLDS[name], ("p50", "mean, throughput"), shape=shape, runs=RUNS).values():
        assert held(found)


@pytest.mark.parametrize("iterations", [2, 3, 4, 5, 10])
def test_iterations_of_one_start(iterations: int) -> None:
    world, shape = WORLDS["iterations differ by 2.7 %"], Shape(1, iterations, 3000 // iterations)
    for found in errors(world, ("p50", "mean, throughput"), shape=shape, runs=RUNS).values():
        assert held(found)


@pytest.mark.parametrize("name", ["nothing differs", "starts differ by 2.7 %"])
def test_many_looks_share_the_error(name: str) -> None:
    quantities = ("p50", "p90", "mean, throughput")
    runs, shape = size(20, 400), Shape(20, 2, 75)
    found = errors(WORLDS[name], quantities, shape=shape, runs=runs, looks=True)
    assert all(held(one) for one in found.values())


def test_a_clear_run_ends_after_three_starts_and_a_close_one_is_decided_later() -> None:
    runs = size(40, 400)
    clear = time_to_verdict(10, 5, runs=runs)
    assert (clear.decided, clear.starts) == (1, 3)
    close = time_to_verdict(1, 5, 24, runs=runs)
    assert close.decided >= 0.95 - noise(0.1)
    assert time_to_verdict(1, 5, looks=False, runs=runs).decided < close.decided - 0.2


@pytest.mark.parametrize("starts", [5, 20])
@pytest.mark.parametrize("name", ["1 start in 5 is slow", "stalls of 40 messages"])
def test_a_run_that_may_end_early_passes_no_oftener_where_something_is_rare(
    name: str, starts: int
) -> None:
    """What three starts cannot have met keeps a PASS waiting for the others."""
    runs, shape = size(10, 300), Shape(starts, 2, 100)
    early, whole = (errors(WORLDS[name], shape=shape, runs=runs, looks=on) for on in (True, False))
    for quantity, found in early.items():
        assert found.passed <= whole[quantity].passed + 0.02 + noise(0.1)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_a_verdict_ends_a_run_where_the_simulated_one_does(quantity: str) -> None:
    world, random = WORLDS["starts differ by 2.7 %"], np.random.default_rng(4)
    looks = InterimLooks.planned(DEFAULT.pieces, DEFAULT.starts)
    for at in (1.05, 1.2, 1.5, 2.0):
        limit = limit_of(world, quantity) * at
        values = world.run(random, DEFAULT)[: looks.iterations[0]]
        verdict = verdict_on(values, quantity, limit, replace(DEFAULT, starts=3), looks=looks)
        (one,) = verdict.requirements
        if one.outcome == "pass":
            confidence = looks.confidence_at(1)
            assert one.early != has_room(values, DEFAULT, quantity, limit, confidence)


@pytest.mark.parametrize("name", RUN_WORLDS)
def test_comparisons_of_one_graph(name: str) -> None:
    world = RUN_WORLDS[name]
    pairs = pairs_errors(world, runs=COMPARISONS)
    assert max(pairs.shares[:2]) <= (
        0.1 + NOISE if name == "runs resemble (0.5)" else chance(0.05, COMPARISONS)
    )
    assert pairs.shares[2] <= chance(0.01, COMPARISONS)


@pytest.mark.parametrize("shape", [Shape(), Shape(1, 10)])
@pytest.mark.parametrize(("truth", "wanted"), [(0.002, 1), (0.03, -1)])
def test_clear_cases_are_decided(truth: float, wanted: int, shape: Shape) -> None:
    world, random = StartWorld(), np.random.default_rng(11)
    limit = world.quantile(1 - truth)
    found = [outcome(world.run(random, shape), shape, "p99", limit) for _ in range(size(30, 200))]
    assert found.count(wanted) >= 0.85 * len(found)
    assert found.count(-wanted) == 0


@pytest.mark.parametrize("quantity", ["p50", "p99"])
def test_the_verdict_of_a_run_is_the_simulated_one(quantity: str) -> None:
    """The verdict asks the test of every limit on one side: that makes it more careful only."""
    world, random = WORLDS["starts differ by 2.7 %"], np.random.default_rng(3)
    words = {1: "pass", -1: "fail", 0: "inconclusive"}
    limit = limit_of(world, quantity) * 1.02
    same = 0
    runs = size(10, 40)
    for _ in range(runs):
        values = world.run(random, DEFAULT)
        verdict = verdict_on(values, quantity, limit)
        simulated = words[outcome(values, DEFAULT, quantity, limit)]
        assert verdict.starts == 5
        assert verdict.outcome in {simulated, "inconclusive"}
        same += verdict.outcome == simulated
    assert same >= 0.9 * runs


@pytest.mark.parametrize(
    "name", ["nothing differs", "iterations differ by 2.7 %", "stalls of 20 messages"]
)
def test_windows_on_the_limit(name: str) -> None:
    assert held(errors(WORLDS[name], (WINDOWS,), runs=size(10, 400))[WINDOWS])


@pytest.mark.parametrize("shape", [Shape(2, 2), Shape(5, 2)])
@pytest.mark.parametrize("name", ["nothing differs", "starts differ by 2.7 %"])
def test_stored_runs_are_compared_by_their_starts(name: str, shape: Shape) -> None:
    found = stored_errors(WORLDS[name], shape, runs=RUNS)
    assert max(found.shares[:2]) <= chance(0.05, RUNS)
