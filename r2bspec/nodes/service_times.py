"""Service times with a known distribution."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

JITTERS = ("none", "exponential")


def service_times_ns(mean_ms: float, jitter: str, seed: int) -> Iterator[int]:
    """Yield an infinite sequence of service times, in nanoseconds.

    With `jitter` "none" each is the mean, and queues before the server behave as in M/D/1 or D/D/1;
    with "exponential" they are independent and exponentially distributed (M/M/1, D/M/1), and
    reproducible with the same `seed`.

    Raises:
        ValueError: `jitter` is not one of `JITTERS`.
    """
    mean_ns = mean_ms * 1e6
    if jitter == "none":
        return itertools.repeat(round(mean_ns))
    if jitter == "exponential":
        generator = np.random.default_rng(seed)
        return (round(generator.exponential(mean_ns)) for _ in itertools.count())
    raise ValueError(f"jitter {jitter!r} is not one of {', '.join(JITTERS)}")
