"""The search for the peak against servers whose capacity is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from r2bspec.execute.measurement.peak_search import PeakSearch, ProbeOutcome
from r2bspec.record.run_record import Probe, SearchRecord
from run_simulation import bracket


class Server:
    """A server of known capacity that drops or queues what is too much.

    Attributes:
        betrays: what it delivers when overloaded, as a share of its capacity; 1 is a server
            that keeps working at full speed, less is one that thrashes.
        player_hz: the rate that the player reaches at most.
        fails_once: rates are failed once, the first time that one in these bounds is probed.
        relative_half_width: the share of the capacity on either side of it that stays open.
    """

    def __init__(
        self,
        capacity_hz: float,
        *,
        betrays: float = 1.0,
        player_hz: float = math.inf,
        fails_once: tuple[float, float] = (0.0, 0.0),
        relative_half_width: float = 0.0,
    ) -> None:
        self.capacity_hz = capacity_hz
        self.probed: list[float] = []
        self._betrays = betrays
        self._player_hz = player_hz
        self._fails_once = fails_once
        self._failed = False
        self._unclear = relative_half_width

    def probe(self, rate_hz: float) -> ProbeOutcome:
        """Answer as a probe of a real graph does."""
        self.probed.append(rate_hz)
        low, high = self._fails_once
        if not self._failed and low <= rate_hz <= high:
            self._failed = True
            return self._outcome(rate_hz, rate_hz * 0.5, holds=False)
        if rate_hz > self._player_hz:
            return self._outcome(rate_hz, self._player_hz, holds=False, limited_by_player=True)
        if abs(rate_hz / self.capacity_hz - 1) < self._unclear:
            return self._outcome(rate_hz, rate_hz, holds=None)
        if rate_hz > self.capacity_hz:
            return self._outcome(rate_hz, self.capacity_hz * self._betrays, holds=False)
        return self._outcome(rate_hz, rate_hz, holds=True)

    def _outcome(
        self,
        rate_hz: float,
        delivered_hz: float,
        *,
        holds: bool | None,
        limited_by_player: bool = False,
    ) -> ProbeOutcome:
        return ProbeOutcome(
            Probe(
                segment=f"probe-{len(self.probed):03d}",
                rate_hz=rate_hz,
                delivered_hz=delivered_hz,
                holds=holds,
                reason="",
            ),
            limited_by_player=limited_by_player,
        )


def search(
    server: Server, minimum_hz: float = 10.0, maximum_hz: float = 1000.0, precision: float = 0.02
) -> SearchRecord:
    return PeakSearch(minimum_hz, maximum_hz, precision, server.probe).run()


@given(
    capacity_hz=st.floats(10.0, 999.0),
    precision=st.floats(0.005, 0.2),
    betrays=st.floats(0.3, 1.0),
)
def test_the_bracket_holds_the_capacity_and_is_as_narrow_as_was_asked(
    capacity_hz: float, precision: float, betrays: float
) -> None:
    server = Server(capacity_hz, betrays=betrays)
    record = search(server, precision=precision)
    holds_hz, fails_hz = bracket(record)
    assert holds_hz <= capacity_hz < fails_hz
    assert fails_hz / holds_hz <= 1 + precision + 1e-9
    assert record.limited_by == "graph"
    assert [probe.rate_hz for probe in record.probes] == server.probed


@given(
    capacity_hz=st.floats(10.0, 999.0),
    precision=st.floats(0.005, 0.2),
    betrays=st.floats(0.05, 1.0),
)
def test_the_search_is_never_much_slower_than_halving(
    capacity_hz: float, precision: float, betrays: float
) -> None:
    server = Server(capacity_hz, betrays=betrays)
    search(server, precision=precision)
    halvings = math.ceil(math.log2(math.log(100.0) / math.log(1 + precision)))
    assert len(server.probed) <= 2 * halvings + 6


def test_a_capacity_above_the_range_is_limited_by_the_range() -> None:
    record = search(Server(2000.0))
    assert record.holds_hz == 1000.0
    assert record.fails_hz is None
    assert record.limited_by == "range"


@given(player_hz=st.floats(10.0, 999.0))
def test_a_player_that_cannot_offer_more_is_named(player_hz: float) -> None:
    server = Server(math.inf, player_hz=player_hz)
    record = search(server)
    holds_hz, fails_hz = bracket(record)
    assert holds_hz <= player_hz < fails_hz
    # A bound of the player, and not of the graph.
    assert (record.limited_by, record.upper_hz) == ("player", None)


@given(
    capacity_hz=st.floats(12.0, 900.0),
    low=st.floats(0.5, 1.0),
    betrays=st.floats(0.3, 1.0),
)
def test_one_hiccup_anywhere_never_gives_a_rate_that_does_not_hold(
    capacity_hz: float, low: float, betrays: float
) -> None:
    hiccup = (capacity_hz * low, capacity_hz)
    record = search(Server(capacity_hz, betrays=betrays, fails_once=hiccup))
    holds_hz, fails_hz = bracket(record)
    assert holds_hz <= capacity_hz
    assert fails_hz / holds_hz <= 1.02 + 1e-9


@given(capacity_hz=st.floats(20.0, 500.0), relative_half_width=st.floats(0.001, 0.4))
def test_what_stays_open_widens_the_bracket_and_is_never_decided(
    capacity_hz: float, relative_half_width: float
) -> None:
    server = Server(capacity_hz, relative_half_width=relative_half_width)
    record = search(server)
    holds_hz, fails_hz = bracket(record)
    assert holds_hz <= capacity_hz * (1 - relative_half_width) + 1e-9
    assert fails_hz >= capacity_hz * (1 + relative_half_width) - 1e-9
    assert all(holds_hz < rate_hz < fails_hz for rate_hz in record.open_hz)
    assert sum(probe.holds is None for probe in record.probes) <= 8
    if not record.open_hz:
        assert fails_hz / holds_hz <= 1.02 + 1e-9


def test_a_search_that_is_cut_short_says_so_and_keeps_what_it_found() -> None:
    server = Server(100.0)

    def cut(rate_hz: float) -> ProbeOutcome:
        if len(server.probed) == 3:
            raise KeyboardInterrupt
        return server.probe(rate_hz)

    started = PeakSearch(10.0, 1000.0, 0.02, cut)
    assert started.record().limited_by == "interrupted"
    with pytest.raises(KeyboardInterrupt):
        started.run()
    record = started.record()
    assert record.limited_by == "interrupted"
    assert [probe.rate_hz for probe in record.probes] == server.probed
    assert record.holds_hz is not None


@given(seed=st.integers(0, 2**32), share=st.floats(0.0, 1.0))
def test_it_ends_whatever_the_answers(seed: int, share: float) -> None:
    random = np.random.default_rng(seed)
    answers = [True, *(random.random(59) < share).tolist()]
    server = Server(1.0)
    script = iter(zip(answers, random.uniform(0.0, 2000.0, 60).tolist(), strict=True))

    def capricious(rate_hz: float) -> ProbeOutcome:
        holds, delivered_hz = next(script, (True, rate_hz))
        return server._outcome(rate_hz, delivered_hz, holds=holds)

    record = PeakSearch(10.0, 1000.0, 0.02, capricious).run()
    assert len(record.probes) <= 60
