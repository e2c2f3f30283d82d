"""Promise: steps come as their kind says, n of them in n periods, and likewise in every run."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest

from r2bspec.ipc.arrivals import delays_ns, step_times_ns
from r2bspec.language.quantities import Share
from r2bspec.language.spec import Arrivals

RATE_HZ, STEPS = 200.0, 2_000
PERIOD_NS = round(1e9 / RATE_HZ)
KINDS = [
    Arrivals(),
    Arrivals(kind="poisson"),
    Arrivals(kind="bursts", size=7),
    Arrivals(kind="bursts", size=7, share=Share(1.0)),
    Arrivals(kind="jitter", share=Share(1.0)),
    Arrivals(kind="dropout", share=Share(0.9)),
]


def intervals(arrivals: Arrivals, name: str = "a", steps: int = STEPS) -> np.ndarray:
    return np.diff(step_times_ns(arrivals, RATE_HZ, steps, name))


@pytest.mark.parametrize("arrivals", KINDS, ids=str)
@pytest.mark.parametrize("steps", [1, 2, 9, STEPS])
def test_n_steps_take_n_periods(arrivals: Arrivals, steps: int) -> None:
    times_ns = step_times_ns(arrivals, RATE_HZ, steps, "a")
    assert times_ns.size == steps
    assert times_ns[0] == 0
    assert times_ns[-1] < steps * PERIOD_NS
    # Two of one time would have one stamp.
    assert (np.diff(times_ns) >= 1_000).all()


def test_intervals_of_poisson_arrivals_are_exponential() -> None:
    distributions = [
        kstest(intervals(Arrivals(kind="poisson", seed=seed)) / PERIOD_NS, "expon").pvalue
        for seed in range(40)
    ]
    # As often as of any true exponential sample, which is one in twenty.
    assert sum(value < 0.05 for value in distributions) <= 6
    assert min(distributions) > 0.001
    assert kstest(intervals(Arrivals()) / PERIOD_NS, "expon").pvalue < 1e-9


def test_a_burst_is_over_after_its_share_of_the_time() -> None:
    found = intervals(Arrivals(kind="bursts", size=4, share=Share(0.2)), steps=8)
    within, between = 0.2 * PERIOD_NS, (4 - 3 * 0.2) * PERIOD_NS
    assert found.tolist() == pytest.approx([within] * 3 + [between] + [within] * 3, rel=1e-6)


def test_jitter_is_at_most_its_share_of_the_interval() -> None:
    late = np.array(delays_ns(Arrivals(kind="jitter", share=Share(0.3)), RATE_HZ, STEPS, "a"))
    assert late.min() >= 0
    assert 0.29 * PERIOD_NS < late.max() <= 0.3 * PERIOD_NS


def test_without_what_drops_out_intervals_are_equal() -> None:
    slot = 0.8 * PERIOD_NS
    slots = intervals(Arrivals(kind="dropout", share=Share(0.2))) / slot
    assert np.abs(slots - np.round(slots)).max() < 1e-3
    assert np.mean(np.round(slots) == 1) == pytest.approx(0.8, abs=0.03)


def test_every_iteration_has_times_of_its_own_in_every_run() -> None:
    poisson = Arrivals(kind="poisson", seed=5)
    assert intervals(poisson, "a").tolist() == intervals(poisson, "a").tolist()
    for other in (intervals(poisson, "b"), intervals(Arrivals(kind="poisson", seed=6), "a")):
        assert intervals(poisson, "a").tolist() != other.tolist()
