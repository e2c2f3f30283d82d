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
    # The lower end twice: the machine may have become slower meanwhile.
    saturations, ends = ["saturation"] * 2, ["confirmation"] * 3
    assert [what for what, _ in graph.played] == ["probe", "probe", *saturations, *ends]


@pytest.mark.parametrize("beyond", [1.0, 1.05, 1.2])
def test_the_upper_end_is_played_and_raised_if_the_graph_keeps_up_with_it(beyond: float) -> None:
    graph = Graph(lambda rate: 97.0 if rate > 100.0 * beyond + 1e-6 else 100.0)
    record = graph.search()
    holds_hz, fails_hz = bracket(record)
    assert holds_hz <= 100.0 < fails_hz
    assert record.proof == "confirmed"
    assert len(graph.played) <= 12


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


def test_no_more_than_the_time_budget_allows_is_played_whole() -> None:
    graph = Graph(lambda _: 100.0, sustains_hz=80.0)
    record = graph.search(allows=lambda: False)
    assert len(graph.rates("confirmation")) == 1
    assert record.proof == "open"


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
