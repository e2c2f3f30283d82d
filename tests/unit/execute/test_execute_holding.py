"""Whether a rate holds, on simulated servers with queues of any depth.

Promise: a rate at which the backlog grows does not hold, however deep the queues are.
"""

from __future__ import annotations

import pytest
from simulated_queues import DEEP, SHALLOW, Server, probe

from r2bspec.execute.holding import Criterion, judge_finished_probe, judge_probe
from r2bspec.measure.delivery import Delivery

DEPTHS = pytest.mark.parametrize("depth", [DEEP, SHALLOW, 1], ids=["deep", "shallow", "one"])
CAPACITIES = pytest.mark.parametrize("capacity_hz", [20.0, 100.0, 400.0])


@DEPTHS
@CAPACITIES
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.98])
def test_below_its_capacity_a_server_holds(depth: int, capacity_hz: float, share: float) -> None:
    found = probe(Server(capacity_hz, depth), share * capacity_hz)
    assert found.judgement.holds is True
    assert found.judgement.reason == "delivered as offered"


@DEPTHS
@CAPACITIES
@pytest.mark.parametrize("share", [1.02, 1.1, 1.5, 4.0])
def test_above_its_capacity_no_server_holds(depth: int, capacity_hz: float, share: float) -> None:
    found = probe(Server(capacity_hz, depth), share * capacity_hz)
    assert found.judgement.holds is False
    assert not found.judgement.by_player


@pytest.mark.parametrize("share", [0.5, 0.9, 1.02, 1.1])
def test_depth_decides_nothing(share: float) -> None:
    verdicts = {
        probe(Server(100.0, depth), share * 100.0).judgement.holds
        for depth in (1, 2, 5, 10, 50, 1_000, DEEP)
    }
    assert verdicts == {share < 1}


def test_what_is_far_from_the_capacity_is_clear_before_the_probe_is_over() -> None:
    assert probe(Server(100.0), 50.0).stopped_s < 2.0
    assert probe(Server(100.0), 400.0).stopped_s < 2.0
    assert probe(Server(100.0, SHALLOW), 400.0).stopped_s < 2.0


def test_an_overload_betrays_the_capacity() -> None:
    # The search takes its next rates from there.
    for depth in (DEEP, SHALLOW):
        found = probe(Server(100.0, depth), 400.0)
        assert found.delivery.delivered_hz == pytest.approx(100.0, rel=0.03)


@pytest.mark.parametrize("depth", [DEEP, 100])
@pytest.mark.parametrize(("share", "holds"), [(0.6, True), (1.25, False), (2.0, False)])
def test_random_service_times_rarely_mislead(depth: int, share: float, holds: bool) -> None:
    answers = [
        probe(Server(100.0, depth, spread=1.0, seed=seed), share * 100.0).judgement.holds
        for seed in range(40)
    ]
    assert answers.count(holds) >= 38


@pytest.mark.parametrize("share", [0.8, 0.9, 1.1])
def test_a_probe_with_random_service_times_is_not_stopped_early_for_the_wrong_reason(
    share: float,
) -> None:
    # So close to its capacity three seconds tell little, but that is no reason to stop sooner.
    wrong_and_early = [
        seed
        for seed in range(60)
        if (found := probe(Server(100.0, spread=1.0, seed=seed), share * 100.0)).stopped_s < 2.9
        and found.judgement.holds is not (share < 1)
    ]
    assert len(wrong_and_early) <= 1


def test_a_rate_that_random_times_cannot_settle_early_is_played_to_its_end() -> None:
    stopped = [probe(Server(100.0, spread=1.0, seed=seed), 100.0).stopped_s for seed in range(20)]
    assert sum(each >= 2.9 for each in stopped) >= 15


@pytest.mark.parametrize(
    ("allowed", "loses", "holds"),
    [(0.0, 0.0, True), (0.0, 0.1, False), (0.05, 0.02, True), (0.05, 0.15, False)],
)
def test_losses_count_only_beyond_what_the_spec_admits(
    allowed: float, loses: float, holds: bool
) -> None:
    criterion = Criterion(precision=0.02, loss=allowed)
    answers = [
        probe(Server(200.0, loses=loses, seed=seed), 100.0, criterion=criterion).judgement
        for seed in range(20)
    ]
    assert sum(each.holds is holds for each in answers) >= 19
    if not holds:
        assert any("dropped" in each.reason for each in answers)


def test_admitted_losses_do_not_excuse_a_backlog() -> None:
    criterion = Criterion(precision=0.02, loss=0.5)
    found = probe(Server(80.0, DEEP), 100.0, criterion=criterion)
    assert found.judgement.holds is False
    assert "backlog" in found.judgement.reason


def test_a_graph_that_stops_answering_does_not_hold() -> None:
    found = probe(Server(1000.0, SHALLOW, stalls=(0.7, 100.0)), 100.0)
    assert found.judgement.holds is False


def test_a_graph_that_answers_nothing_does_not_hold() -> None:
    found = probe(Server(1000.0, loses=1.0), 50.0)
    assert found.judgement.holds is False
    assert found.delivery.delivered_hz == 0.0


def test_what_the_player_cannot_offer_is_not_held_against_the_graph() -> None:
    found = probe(Server(1000.0), 400.0, player_hz=300.0)
    assert found.judgement.holds is False
    assert found.judgement.by_player
    assert found.judgement.reason == "the player reached only 300 Hz"


def test_a_player_that_is_almost_as_fast_as_asked_does_not_limit() -> None:
    found = probe(Server(1000.0), 400.0, player_hz=396.0)
    assert found.judgement.holds is True


def sample(**changes: float) -> Delivery:
    values: dict[str, float] = {
        "offered_hz": 100.0,
        "player_hz": 100.0,
        "delivered_hz": 100.0,
        "standard_error_hz": 0.01,
        "settled_hz": 100.0,
        "settled_error_hz": 0.01,
        "batches": 10,
        "drop_share": 0.0,
        "published": 200,
        "answered": 200,
        "lateness_p99_s": 0.0,
    }
    return Delivery(**(values | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("delivery", "elapsed_s"),
    [(sample(), 0.9), (sample(published=29), 5.0), (sample(batches=0), 5.0)],
)
def test_nothing_is_decided_too_early(delivery: Delivery, elapsed_s: float) -> None:
    judgement = judge_probe(delivery, Criterion(precision=0.02), elapsed_s)
    assert judgement.holds is None
    assert judgement.reason == "too early to tell"


@pytest.mark.parametrize(
    ("settled_hz", "holds"), [(99.2, True), (99.05, None), (98.95, None), (98.8, False)]
)
def test_a_rate_is_decided_when_it_is_clear_of_the_limit(
    settled_hz: float, holds: bool | None
) -> None:
    # The limit is 99 Hz: half the precision below the offer. Clear are four standard errors.
    close = sample(settled_hz=settled_hz, settled_error_hz=0.04)
    assert judge_probe(close, Criterion(precision=0.02), 2.0).holds is holds


@pytest.mark.parametrize(("settled_hz", "holds"), [(99.0, True), (98.99, False)])
def test_at_the_end_the_estimate_itself_decides(settled_hz: float, holds: bool) -> None:
    final = sample(settled_hz=settled_hz, settled_error_hz=5.0)
    assert judge_finished_probe(final, Criterion(precision=0.02)).holds is holds
