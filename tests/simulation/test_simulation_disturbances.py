"""A disturbed machine: wrong fails stay within their level, and what is hopeless always fails."""

from __future__ import annotations

import pytest
from simulated_disturbances import Kind, Machine, outcomes

from nightly import noise, sampled, size

pytestmark = pytest.mark.simulation

RUNS = size(12, 100)
LEVEL = 0.05
ON_THE_LIMIT = 1.8
"""Of so slow a graph still 1 % of the messages are over the limit, and the others just below."""

KINDS: tuple[Kind, ...] = ("stalls", "contention")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", sampled([0.3, 1.0], 2))
def test_wrong_fails_stay_within_their_level(kind: Kind, share: float) -> None:
    found = outcomes(Machine(kind, share), runs=RUNS, slower=ON_THE_LIMIT)
    played, known = found.fails()
    assert played > 0.5
    assert known <= LEVEL + noise(0.05)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", sampled([0.3, 1.0], 2))
def test_nothing_becomes_a_pass(kind: Kind, share: float) -> None:
    found = outcomes(Machine(kind, share), runs=RUNS // 4, slower=0.5)
    assert found.known["pass"] == found.played["pass"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", sampled([0.0, 0.3, 1.0], 2))
def test_what_is_hopeless_always_fails(kind: Kind, share: float) -> None:
    # Most of its messages take over four times as long as 99 % may.
    found = outcomes(Machine(kind, share), runs=size(2, 10), slower=14.0)
    assert found.fails() == (1.0, 1.0)


def test_a_failure_is_still_found_where_reruns_are_undisturbed() -> None:
    for kind in KINDS:
        _, known = outcomes(Machine(kind, 0.3), runs=RUNS // 4, slower=2.5).fails()
        assert known >= 0.95
