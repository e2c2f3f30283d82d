"""Service times of the calibration relay."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from r2bspec.nodes.service_times import service_times_ns


def test_without_jitter_each_message_takes_the_same() -> None:
    assert list(islice(service_times_ns(2.5, "none", 0), 3)) == [2_500_000] * 3


def test_exponential_times_have_the_mean_and_the_spread_of_their_distribution() -> None:
    times_ms = np.array(list(islice(service_times_ns(5.0, "exponential", 3), 20_000))) / 1e6
    # Mean and standard deviation of an exponential distribution are equal; 4 sigma of the estimate.
    assert times_ms.mean() == pytest.approx(5.0, abs=4 * 5.0 / 20_000**0.5)
    assert times_ms.std() == pytest.approx(5.0, rel=0.06)


def test_the_seed_decides_the_sequence() -> None:
    def first(seed: int) -> list[int]:
        return list(islice(service_times_ns(5.0, "exponential", seed), 5))

    assert first(1) == first(1)
    assert first(1) != first(2)
