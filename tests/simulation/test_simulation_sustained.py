"""`sustained`, and so every probe of a search, on queues close to their capacity.

A probe may be wrong in 1.25 % of cases (`r2bspec.judge.rate_decision`): of n probes more than
n x 1.25 % + 4 sqrt(n x 1.25 %) are wrong once in some ten thousand.
"""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

from nightly import sampled, size
from r2bspec.judge.rate_decision import Criterion
from simulated_peaks import PRECISION, Kind, outcome
from simulated_queues import SUSTAINED, Server, probe
from simulated_speeds import Graph, World

pytestmark = pytest.mark.simulation

_PROBES = size(10, 80)
_MOST_WRONG = _PROBES * 0.0125 + 4 * math.sqrt(_PROBES * 0.0125)


def outcomes(kind: Kind, load: float, seconds: float, probes: int) -> Counter[str]:
    return Counter(outcome(kind, load, seconds=seconds, seed=seed) for seed in range(probes))


@pytest.mark.parametrize("kind", ["D/M/1", "M/D/1", "M/M/1"])
@pytest.mark.parametrize("load", sampled([0.95, 0.9, 0.8], 3))
def test_a_rate_below_the_capacity_rarely_fails(kind: Kind, load: float) -> None:
    assert outcomes(kind, load, 10, _PROBES)["fail"] <= _MOST_WRONG


@pytest.mark.parametrize("kind", ["D/M/1", "M/D/1", "M/M/1"])
@pytest.mark.parametrize("load", sampled([1.05, 1.1, 1.2], 3))
def test_a_rate_above_the_capacity_rarely_passes(kind: Kind, load: float) -> None:
    assert outcomes(kind, load, 10, _PROBES)["pass"] <= _MOST_WRONG


def test_ten_seconds_show_that_random_times_are_kept_up_with() -> None:
    few = size(10, 30)
    assert outcomes("D/M/1", 0.7, 10, few)["pass"] >= 0.9 * few
    assert outcomes("D/M/1", 1.3, 10, few)["fail"] >= 0.9 * few


@pytest.mark.parametrize("variation", [0.1, 0.3, 0.6])
def test_two_standard_errors_and_the_precision_above_the_capacity_rarely_pass(
    variation: float,
) -> None:
    load = 1 + PRECISION + 2 * variation / math.sqrt(1000)
    probes = size(10, 80)
    passes = 0
    for seed in range(probes):
        graph = Graph(World(variation=variation), 100.0, np.random.default_rng(seed))
        found = probe(graph, 100.0 * load, criterion=Criterion(PRECISION), play=SUSTAINED)
        passes += found.judgement.holds is True
    assert passes <= probes * 0.0125 + 4 * math.sqrt(probes * 0.0125)


def test_a_loss_within_the_tolerance_rarely_fails() -> None:
    fails = 0
    for seed in range(_PROBES):
        server = Server(1000.0, loses=0.005, seed=seed)
        found = probe(server, 100.0, criterion=Criterion(PRECISION), play=SUSTAINED)
        fails += found.judgement.holds is False
    assert fails <= _MOST_WRONG
