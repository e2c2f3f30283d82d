"""The peak search with overloads and whole plays, against graphs of known habits."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from r2bspec.execute.measurement.peak_search import LongPlays, Overload, PeakSearch, ProbeOutcome
from r2bspec.judge.stationarity import CompletionTimes
from r2bspec.record.run_record import Probe, SearchRecord
from run_simulation import bracket

SECONDS = 10.0


class Graph:
    """A graph with equal service times.

    Attributes:
        capacity_hz: by the rate that is offered; less under more load is a graph that drowns.
        sustains_hz: up to which a whole play confirms; by default the capacity.
        loses: the share lost at any rate.
        opens: rates that stay undecided when they are played whole.
        played: (what for, rate) of everything that was played.
    """

    def __init__(
        self,
        capacity_hz: Callable[[float], float],
        *,
        sustains_hz: float | None = None,
        loses: float = 0.0,
        opens: Callable[[float], bool] = lambda _: False,
    ) -> None:
        self.capacity_hz = capacity_hz
        self.sustains_hz = sustains_hz if sustains_hz is not None else capacity_hz(0.0)
        self.loses = loses
        self.opens = opens
        self.played: list[tuple[str, float]] = []

    def outcome(self, purpose: str, rate_hz: float) -> ProbeOutcome:
        self.played.append((purpose, rate_hz))
        speed_hz = min(rate_hz, self.capacity_hz(rate_hz))
        holds: bool | None = rate_hz <= self.capacity_hz(rate_hz)
        if purpose == "confirmation":
            holds = rate_hz <= self.sustains_hz and not self.loses
            speed_hz = min(speed_hz, self.sustains_hz)
            if self.opens(rate_hz):
                holds = None
        times_s = np.arange(1, round(SECONDS * speed_hz)) / speed_hz
        kept = (np.arange(times_s.size) % round(1 / self.loses)) > 0 if self.loses else slice(None)
        return ProbeOutcome(
            Probe(
                segment="",
                rate_hz=rate_hz,
                delivered_hz=speed_hz,
                holds=holds,
                reason="",
                purpose=purpose,  # type: ignore[arg-type]
                keeps_up=holds,
                lost_at_most=0.005,
                played_s=SECONDS,
            ),
            departures=CompletionTimes(
                float(len(self.played)) * 12, times_s[kept], SECONDS, rate_hz
            ),
            drop_share=self.loses,
        )

    def search(
        self,
        *,
        minimum_hz: float = 10.0,
        maximum_hz: float = 1000.0,
        confirms: bool = True,
        allows: Callable[[], bool] = lambda: True,
        search_s: float = math.inf,
    ) -> SearchRecord:
        def confirm(rate_hz: float, proven_hz: float) -> ProbeOutcome:
            assert proven_hz >= 0
            return self.outcome("confirmation", rate_hz)

        def upper(rate_hz: float, needed_s: float) -> ProbeOutcome:
            assert needed_s >= 0
            return self.outcome("confirmation", rate_hz)

        return PeakSearch(
            minimum_hz,
            maximum_hz,
            0.02,
            lambda rate_hz: self.outcome("probe", rate_hz),
            long_plays=LongPlays(
                overload=lambda rate_hz: self.outcome("saturation", rate_hz),
                confirm=confirm if confirms else None,
                upper=upper if confirms else None,
                search_s=search_s,
                budget_s=60.0,
                allows=allows,
            ),
        ).run()

    def rates(self, purpose: str) -> list[float]:
        return [rate_hz for what, rate_hz in self.played if what == purpose]


def steady(capacity_hz: float) -> Graph:
    return Graph(lambda _: capacity_hz)


@pytest.mark.parametrize("capacity_hz", [23.0, 100.0, 480.0])
def test_the_bracket_is_proved_and_as_narrow_as_was_asked(capacity_hz: float) -> None:
    graph = steady(capacity_hz)
    record = graph.search()
    holds_hz, fails_hz = bracket(record)
    assert holds_hz <= capacity_hz < fails_hz <= holds_hz * (1.02 + 1e-9)
    assert record.proof == "confirmed"
    assert record.shown
    assert record.proof_s == SECONDS
    saturations, ends = ["saturation"] * 2, ["confirmation"] * 2
    assert [what for what, _ in graph.played] == ["probe", "probe", *saturations, *ends]


def test_a_graph_that_drowns_is_not_bounded_by_its_overload() -> None:
    # At twice its capacity and more it does 60, at a third more 80.
    graph = Graph(lambda rate: 60.0 if rate > 200 else 80.0 if rate > 115 else 100.0)
    holds_hz, fails_hz = bracket(graph.search())
    assert holds_hz <= 100.0 < fails_hz


@pytest.mark.parametrize("falls", [0.03, 0.05, 0.1, 0.2, 0.5])
def test_the_search_of_a_graph_that_is_slower_the_more_is_offered_ends(falls: float) -> None:
    graph = Graph(lambda rate: 100.0 / (1 + falls * max(rate / 100.0 - 1, 0)))
    holds_hz, fails_hz = bracket(graph.search())
    assert len(graph.rates("saturation")) <= 9  # three that keep up, six of 10 s
    assert holds_hz <= 100.0 <= fails_hz


@pytest.mark.parametrize("beyond", [1.0, 1.05, 1.2])
def test_the_upper_end_is_played_and_raised_if_the_graph_keeps_up_with_it(beyond: float) -> None:
    graph = Graph(lambda rate: 97.0 if rate > 100.0 * beyond + 1e-6 else 100.0)
    record = graph.search()
    holds_hz, fails_hz = bracket(record)
    assert holds_hz <= 100.0 < fails_hz
    assert record.proof == "confirmed"
    assert len(graph.played) <= 12


def test_the_upper_end_stays_where_no_time_is_left_to_play_a_higher_one() -> None:
    graph = Graph(lambda rate: 97.0 if rate > 100.0 + 1e-6 else 100.0)
    record = graph.search(search_s=0.0)
    # The lowest rate that was not sustained is one of the overloads.
    assert record.fails_hz == min(graph.rates("saturation"))
    assert len(graph.played) == 6


def test_a_lower_end_that_is_refuted_is_not_the_peak() -> None:
    graph = Graph(lambda _: 100.0, sustains_hz=80.0)
    holds_hz, fails_hz = bracket(graph.search())
    first, *others = graph.rates("confirmation")
    assert first > 80.0
    assert others
    assert fails_hz <= first
    assert holds_hz <= 80.0


def test_a_graph_that_loses_messages_at_any_rate_has_no_proved_peak() -> None:
    graph = Graph(lambda _: 100.0, loses=0.05)
    record = graph.search()
    assert record.proof == "open"
    assert not record.shown
    assert len(graph.rates("confirmation")) == 3
    assert record.fails_hz == min(graph.rates("confirmation"))


def test_what_stays_open_when_it_is_played_whole_is_reported_as_open() -> None:
    graph = Graph(lambda _: 100.0, opens=lambda _: True)
    record = graph.search()
    rates = graph.rates("confirmation")
    assert len(rates) == 3
    assert rates == sorted(rates, reverse=True)
    assert record.proof == "open"
    assert record.holds_hz == rates[0]


def test_a_lower_rate_is_confirmed_if_the_first_stays_open() -> None:
    graph = Graph(lambda _: 100.0, opens=lambda rate: rate > 97.0)
    record = graph.search()
    assert record.proof == "confirmed"
    assert record.holds_hz == graph.rates("confirmation")[1]


def test_no_more_than_the_time_budget_allows_is_played_whole() -> None:
    graph = Graph(lambda _: 100.0, sustains_hz=80.0)
    record = graph.search(allows=lambda: False)
    assert len(graph.rates("confirmation")) == 1
    assert record.proof == "open"


def test_without_a_whole_play_the_bracket_is_one_of_probes() -> None:
    graph = steady(100.0)
    record = graph.search(confirms=False)
    assert record.proof == "probes"
    assert not record.shown
    assert graph.rates("confirmation") == []
    assert record.holds_hz is not None
    assert record.holds_hz <= 100.0


def test_the_end_of_the_range_is_played_whole_too() -> None:
    graph = steady(5000.0)
    record = graph.search()
    assert graph.rates("confirmation") == [1000.0]
    assert graph.rates("saturation") == []
    assert (record.holds_hz, record.limited_by, record.proof) == (1000.0, "range", "confirmed")


def overload(
    play: Callable[[float], CompletionTimes | None],
    precision: float = 0.02,
    goes_on: Callable[[], bool] = lambda: True,
    **plays: float,
) -> Overload:
    long_plays = LongPlays(**{"budget_s": 60.0, **plays})  # type: ignore[arg-type]
    return Overload(play, 1000.0, precision, 0.95, long_plays, goes_on)


def test_an_overload_that_is_none_is_raised_until_it_is_one() -> None:
    offered: list[float] = []

    def play(rate_hz: float) -> CompletionTimes:
        offered.append(rate_hz)
        speed_hz = min(rate_hz, 100.0)
        return CompletionTimes(0.0, np.arange(1, 10 * speed_hz) / speed_hz, 10.0, rate_hz)

    found = overload(play).run(40.0)
    assert found is not None
    assert found.hz == pytest.approx(100.0)
    assert offered[:4] == pytest.approx([52.0, 67.6, 87.9, 114.2], abs=0.1)
    assert overload(play).run(5.0) is None


def test_overloading_ends_with_its_time() -> None:
    random = np.random.default_rng(1)

    def play(rate_hz: float) -> CompletionTimes:
        return CompletionTimes(0.0, np.cumsum(random.gamma(12.0, 1 / 1200, 1000)), 10.0, rate_hz)

    tried = overload(play, precision=0.002)
    found = tried.run(100.0)
    assert found is not None
    assert found.relative_width > 0.002
    assert math.isclose(sum(shown.played_s for shown in tried.shown), 60.0)


def test_what_is_faster_with_less_overload_than_was_estimated_has_no_capacity() -> None:
    def play(rate_hz: float) -> CompletionTimes:
        speed_hz = rate_hz if rate_hz < 110.0 else 90.0
        return CompletionTimes(0.0, np.arange(1, 10 * speed_hz) / speed_hz, 10.0, rate_hz)

    tried = overload(play, budget_s=20.0)
    assert tried.run(90.0) is None
    assert tried.upper_hz is None


def test_without_time_the_graph_is_overloaded_twice() -> None:
    played: list[float] = []

    def play(rate_hz: float) -> CompletionTimes:
        played.append(rate_hz)
        random = np.random.default_rng(10 + len(played))
        return CompletionTimes(0.0, np.cumsum(random.gamma(12.0, 1 / 1200, 1000)), 10.0, rate_hz)

    assert overload(play, goes_on=lambda: False).run(100.0) is not None
    assert len(played) == 2


def test_lost_messages_that_are_allowed_raise_the_upper_end() -> None:
    def play(rate_hz: float) -> CompletionTimes:
        return CompletionTimes(0.0, np.arange(1, 1000) / 100.0, 10.0, rate_hz)

    strict, lenient = overload(play), overload(play, loss=0.1)
    strict.run(100.0)
    lenient.run(100.0)
    assert strict.upper_hz is not None
    assert lenient.upper_hz == pytest.approx(strict.upper_hz / 0.9)
    assert lenient.lower_hz == strict.lower_hz
