"""When the steps of a playback come, if not at equal intervals.

Arrivals at equal intervals are the kindest load: a queue of requests forms only if some are slower
than the interval. In service they come irregularly, and the tail of the latency consists of
requests that came soon after others. The server scenario of MLPerf Inference plays Poisson arrivals
for that reason.

All kinds have the number and the length of a playback at equal intervals, n steps in T = n / rate,
and the first step at 0, so that the rate is their mean rate. With u drawn from a seed:

    poisson    the other n - 1 steps are at sorted uniform times in (0, T). Given their number, the
               times of a Poisson process are distributed like this.
    bursts     step i is i // size bursts and share x (i % size) / size of the time between two
               bursts after the first step
    jitter     step i is i + share x u intervals after the first step, without u for the first
    dropout    of n / (1 - share) equal intervals in T, the first and n - 1 others have a step
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from r2bspec.language.spec import Arrivals

_LEAST_NS = 1_000
"""Between two steps: their stamps differ, and no player publishes faster."""


def step_times_ns(arrivals: Arrivals, rate_hz: float, steps: int, name: str) -> NDArray[np.int64]:
    """Return when steps are due, in ns after the first step, ascending.

    Args:
        arrivals: their kind and seed.
        rate_hz: the mean rate.
        steps: how many.
        name: the name of the segment, which has times of its own.
    """
    random = np.random.default_rng([arrivals.seed, *name.encode()])
    share = 0.0 if arrivals.share is None else arrivals.share.fraction
    places = np.arange(steps, dtype=np.float64)
    match arrivals.kind:
        case "poisson":
            places[1:] = np.sort(random.uniform(0, steps, max(0, steps - 1)))
        case "bursts":
            burst, member = np.divmod(places, arrivals.size)
            places = arrivals.size * burst + share * member
        case "jitter":
            places[1:] += share * random.random(max(0, steps - 1))
        case "dropout":
            slots = math.ceil(steps / (1 - share))
            chosen = random.choice(np.arange(1, slots), max(0, steps - 1), replace=False)
            places[1:] = np.sort(chosen) * (steps / slots)
    times_ns = np.rint(places * (1e9 / rate_hz)).astype(np.int64)
    least_ns = _LEAST_NS * np.arange(steps)
    return np.maximum.accumulate(times_ns - least_ns) + least_ns


def delays_ns(arrivals: Arrivals, rate_hz: float, steps: int, name: str) -> tuple[int, ...]:
    """Return how much later than at equal intervals each step is due; see `step_times_ns`."""
    equal_ns = np.rint(np.arange(steps) * (1e9 / rate_hz)).astype(np.int64)
    delays: list[int] = (step_times_ns(arrivals, rate_hz, steps, name) - equal_ns).tolist()
    return tuple(delays)
