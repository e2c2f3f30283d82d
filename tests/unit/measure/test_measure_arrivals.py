"""Promise: of a graph that keeps up, the same is measured however irregularly steps come."""

from __future__ import annotations

import numpy as np
import pytest

from r2bspec.judge.measure.samples import SegmentSamples
from r2bspec.judge.validity import schedule_problem
from r2bspec.language.quantities import Share
from r2bspec.language.spec import Arrivals
from run_simulation import Played, Simulation

RATE_HZ = 30.0
KINDS = [
    *(Arrivals(kind="poisson", seed=seed) for seed in range(12)),
    Arrivals(kind="bursts", size=5),
    Arrivals(kind="jitter", share=Share(0.5)),
    Arrivals(kind="dropout", share=Share(0.15)),
]


def iteration(arrivals: Arrivals, steps: int = 25, strangers: int = 0) -> SegmentSamples:
    latency = np.random.default_rng(1).uniform(0.01, 0.02, steps)
    played = Played(RATE_HZ, latency, strangers=strangers, arrivals=arrivals)
    (found,) = Simulation(segments=[played]).samples().iterations[RATE_HZ]
    return found


@pytest.mark.parametrize("arrivals", KINDS, ids=str)
def test_a_graph_that_keeps_up_has_the_offered_rate(arrivals: Arrivals) -> None:
    found = iteration(arrivals)
    assert schedule_problem(RATE_HZ, [found]) == ""
    # An output that is answered after the end extends the time by no period.
    assert found.monitors["detections"].throughput_hz == pytest.approx(RATE_HZ, rel=0.02)


@pytest.mark.parametrize("arrivals", KINDS, ids=str)
def test_outputs_that_follow_the_inputs_have_no_pace_of_their_own(arrivals: Arrivals) -> None:
    assert iteration(arrivals, 300, strangers=3).monitors["detections"].own_period_s is None
