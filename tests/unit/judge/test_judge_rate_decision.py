"""Whether a rate holds, on simulated servers with queues of any depth.

Promise: a rate at which the backlog grows is not sustained, however deep the queues are.
"""

from __future__ import annotations

from typing import Any

import pytest

from nightly import sampled, size
from r2bspec.judge.rate_decision import Criterion
from simulated_queues import DEEP, SHALLOW, SUSTAINED, Probed, Searching, Server, probe


def sustained(server: Server, rate_hz: float, **how: Any) -> Probed:
    """Probe a rate that an objective requires to be sustained: whole, with enough messages."""
    return probe(server, rate_hz, play=SUSTAINED, **how)


DEPTHS = pytest.mark.parametrize("depth", [DEEP, SHALLOW, 1], ids=["deep", "shallow", "one"])
CAPACITIES = pytest.mark.parametrize("capacity_hz", [20.0, 100.0, 400.0])


@DEPTHS
@CAPACITIES
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.98])
def test_below_its_capacity_a_server_holds(depth: int, capacity_hz: float, share: float) -> None:
    judgement = sustained(Server(capacity_hz, depth), share * capacity_hz).judgement
    assert judgement.keeps_up is True
    if share * capacity_hz * 60 >= Criterion(precision=0.02).messages_without_loss:
        assert judgement.holds is True
        assert judgement.reason == "delivered as offered"
    else:
        # At 2 Hz, 120 messages without a loss do not show that less than 1 % is lost.
        assert judgement.holds is None
        assert judgement.reason.startswith("keeps up; at most ")


@DEPTHS
@CAPACITIES
@pytest.mark.parametrize("share", [1.02, 1.1, 1.5, 4.0])
def test_above_its_capacity_no_server_holds(depth: int, capacity_hz: float, share: float) -> None:
    found = probe(Server(capacity_hz, depth), share * capacity_hz)
    assert found.judgement.holds is False
    assert not found.judgement.limited_by_player


def test_what_is_far_from_the_capacity_is_clear_before_the_probe_is_over() -> None:
    assert probe(Server(100.0), 50.0).stopped_s < 2.0
    assert probe(Server(100.0), 400.0).stopped_s < 2.0
    assert probe(Server(100.0, SHALLOW), 400.0).stopped_s < 2.0


def test_what_random_times_do_not_settle_stays_open_and_says_between_what() -> None:
    found = [probe(Server(100.0, spread=1.0, seed=seed), 100.0) for seed in range(20)]
    still_open = [each for each in found if each.judgement.holds is None]
    assert len(still_open) >= 10
    assert all(each.stopped_s >= 9.9 for each in still_open)
    assert all("the backlog grows by" in each.judgement.reason for each in still_open)


@pytest.mark.parametrize(
    ("allowed", "loses", "holds"),
    [(0.0, 0.0, True), (0.0, 0.1, False), (0.05, 0.02, True), (0.05, 0.15, False)],
)
def test_losses_count_only_beyond_what_the_spec_admits(
    allowed: float, loses: float, holds: bool
) -> None:
    criterion = Criterion(precision=0.02, loss=allowed)
    answers = [
        sustained(Server(200.0, loses=loses, seed=seed), 100.0, criterion=criterion).judgement
        for seed in range(20)
    ]
    assert sum(answer.holds is holds for answer in answers) >= 19
    if not holds:
        assert any("dropped" in answer.reason for answer in answers)


LOSING_HALF = Criterion(precision=0.02, loss=0.5)


@pytest.mark.parametrize(
    ("server", "rate_hz", "how", "words", "not_words"),
    [
        # Admitted losses do not excuse a backlog.
        (Server(80.0, DEEP), 100.0, {"criterion": LOSING_HALF}, ["backlog"], []),
        (Server(1000.0, SHALLOW, stalls=(0.7, 100.0)), 100.0, {}, [], []),
        (Server(1000.0, loses=1.0), 50.0, {}, ["no output"], []),
        (Server(97.0, SHALLOW), 300.0, {}, ["are dropped"], ["backlog"]),
        (Server(97.0, DEEP), 300.0, {}, ["backlog"], ["dropped"]),
        (Server(60.0, 100), 100.0, {}, ["backlog", "dropped"], []),
        # A graph that fails at the rate of a slow player limits itself.
        (Server(100.0), 400.0, {"player_hz": 300.0}, [], ["player"]),
    ],
)
def test_what_is_not_sustained_is_named_as_what_it_is(
    server: Server, rate_hz: float, how: dict[str, Any], words: list[str], not_words: list[str]
) -> None:
    judgement = probe(server, rate_hz, **how).judgement
    assert judgement.holds is False
    assert not judgement.limited_by_player
    assert all(word in judgement.reason for word in words)
    assert not any(word in judgement.reason for word in not_words)


def test_what_the_player_cannot_offer_is_not_held_against_the_graph() -> None:
    found = probe(Server(1000.0), 400.0, player_hz=300.0)
    assert found.judgement.holds is False
    assert found.judgement.limited_by_player
    assert found.judgement.reason == "the player reached only 300 Hz"


@pytest.mark.parametrize(
    ("server", "rate_hz", "how"),
    [
        # A player that is almost as fast as asked does not limit.
        (Server(1000.0), 400.0, {"player_hz": 396.0}),
        # Every message takes 0.4 s, and as many as that are inside from then on.
        (Server(100.0, stages=40), 90.0, {}),
        # It does nothing for a second, and has caught up soon after.
        (Server(1000.0, stalls=(0.2, 1.2)), 100.0, {}),
    ],
)
def test_what_looks_like_an_overload_and_is_none(
    server: Server, rate_hz: float, how: dict[str, Any]
) -> None:
    assert sustained(server, rate_hz, **how).judgement.holds is True


@pytest.mark.parametrize("loses", [0.02, 0.1])
@pytest.mark.parametrize("rate_hz", sampled([10.0, 20.0, 60.0, 30.0], 2))
def test_a_probe_that_saw_no_drop_does_not_show_that_none_is_dropped(
    loses: float, rate_hz: float
) -> None:
    servers = [Server(1000.0, loses=loses, seed=seed) for seed in range(size(12, 50))]
    found = [probe(server, rate_hz).judgement for server in servers]
    assert not any(each.holds for each in found)
    assert any(each.keeps_up and "at most" in each.reason for each in found)


def test_a_graph_is_not_failed_in_its_first_seconds() -> None:
    assert probe(Server(100.0), 120.0).stopped_s >= 5.0


def test_a_rate_that_must_be_sustained_is_played_whole() -> None:
    assert sustained(Server(1000.0), 100.0).stopped_s == pytest.approx(9.99)
    assert probe(Server(1000.0), 100.0).stopped_s < 2.0


@pytest.mark.parametrize("share", [1.1, 1.5])
def test_the_peak_of_a_graph_that_drops_is_found_in_a_range_just_above_it(share: float) -> None:
    searching = Searching(Server(100.0, 1), Criterion(precision=0.02))
    record = searching.run(10.0, share * 100.0)
    assert record.shown
    assert record.fails_hz is not None
    assert record.holds_hz is not None
    assert record.holds_hz <= 100.0 < record.fails_hz <= record.holds_hz * 1.02 * (1 + 1e-9)
