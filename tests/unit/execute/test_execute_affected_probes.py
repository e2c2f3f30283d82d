"""Probes that other programs disturbed: played again, or kept out of the bracket."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, Literal, cast

import numpy as np
import pytest

from r2bspec.execute.measurement.peak_search import LongPlays, PeakSearch, ProbeOutcome
from r2bspec.execute.measurement.rate_probe import AffectedProbes
from r2bspec.execute.run_context import Interference, TimeBudget, interference_of
from r2bspec.judge.measure.host_usage import HostInterference
from r2bspec.judge.stationarity import CompletionTimes
from r2bspec.record.run_record import Probe, SearchRecord, Segment
from run_simulation import bracket, segment_of

QUIET = Interference()
Purpose = Literal["probe", "saturation", "confirmation"]
BUSY = Interference(("other processes used 1.7 of 2 cores (limit 0.5)",), taken=0.4)


class Machine:
    """A server of 95 Hz on a machine that strangers use during some probes.

    Attributes:
        around: what strangers do in each probe, the last one from then on.
        notes: what the run was told.
    """

    capacity_hz = 95.0

    def __init__(
        self,
        *around: Interference,
        policy: Literal["tolerate", "note"] = "note",
        budget_ns: int = 0,
    ) -> None:
        self.around = around
        self.notes: list[str] = []
        self.played: list[float] = []
        self.purpose: Purpose = "probe"
        budget = TimeBudget(budget_ns, self.notes.append)
        budget.begin()
        context: Any = SimpleNamespace(
            budget=budget, note=self.notes.append, host=SimpleNamespace(between=self._between)
        )
        self._probes = AffectedProbes(policy, 0.02, cast("Any", self), context)

    def probe(self, rate_hz: float, purpose: Purpose = "probe") -> ProbeOutcome:
        return self._probes.play(lambda: self._play(rate_hz, purpose))

    def search(self) -> SearchRecord:
        return PeakSearch(10.0, 400.0, 0.02, self.probe).run()

    def _now(self) -> Interference:
        return self.around[min(len(self.played), len(self.around)) - 1]

    def _play(self, rate_hz: float, purpose: Purpose) -> ProbeOutcome:
        self.played.append(rate_hz)
        self.purpose = purpose
        capacity_hz = self.capacity_hz * (1 - self._now().taken)
        delivered_hz = min(rate_hz, capacity_hz)
        return ProbeOutcome(
            Probe(
                segment=f"probe-{len(self.played):03d}",
                rate_hz=rate_hz,
                delivered_hz=delivered_hz,
                holds=rate_hz <= capacity_hz,
                reason="",
                purpose=purpose,
            ),
            departures=CompletionTimes(
                12.0 * len(self.played), np.arange(1, 10 * delivered_hz) / delivered_hz, 10, rate_hz
            ),
        )

    @property
    def segments(self) -> list[Segment]:
        """What was played last, as the player has it."""
        return [segment_of(self.played[-1], 100, start_ns=0, length_ns=10**9)]

    def _between(self, began_ns: int, ended_ns: int) -> Interference:
        assert (began_ns, ended_ns) == (0, 10**9)
        return self._now()


def test_an_undisturbed_probe_is_played_once_and_unchanged() -> None:
    machine = Machine(QUIET)
    assert machine.probe(100.0).probe.holds is False
    assert machine.played == [100.0]
    assert machine.probe(100.0).probe.disturbed == ()


def test_what_a_stranger_may_have_caused_is_played_again() -> None:
    machine = Machine(BUSY, QUIET)
    found = machine.probe(90.0).probe
    assert (found.holds, found.disturbed, found.explained) == (True, (), False)
    assert (found.segment, found.rerun_of) == ("probe-002", "probe-001")
    assert machine.notes == [f"host interference in probe-001 ({BUSY.reasons[0]}): repeating it"]


@pytest.mark.parametrize(
    ("rate_hz", "is_sustained"),
    # Others took 40 % of the time; of 400 Hz, 57 come out, which that does not explain.
    [(50.0, True), (400.0, False)],
)
def test_what_no_stranger_explains_is_decided_at_once(rate_hz: float, is_sustained: bool) -> None:
    machine = Machine(BUSY)
    probe = machine.probe(rate_hz).probe
    assert (probe.holds, probe.disturbed, probe.explained) == (is_sustained, BUSY.reasons, False)
    assert machine.played == [rate_hz]


def test_nothing_is_played_again_without_time() -> None:
    machine = Machine(BUSY, budget_ns=1)
    assert machine.probe(90.0).probe.explained
    assert machine.played == [90.0]
    assert machine.notes[0].startswith("no rerun of probe-001, which host interference affected")


def test_on_a_busy_machine_the_peak_is_at_best_a_lower_bound() -> None:
    machine = Machine(BUSY)
    found = machine.search()
    assert found.limited_by == "interference"
    # It holds what is left of the server, and the failures just above say nothing.
    holds_hz, fails_hz = bracket(found)
    assert 0.95 * 57.0 <= holds_hz <= 57.0
    assert fails_hz == 400.0
    assert found.disturbed == BUSY.reasons


class Overloaded(Machine):
    """A machine that strangers use while it plays for one purpose; it is overloaded, too."""

    def __init__(self, disturbed: Purpose, by: Interference) -> None:
        super().__init__(QUIET)
        self._disturbed, self._by = disturbed, by

    def _now(self) -> Interference:
        return self._by if self.purpose == self._disturbed else QUIET

    def search(self) -> SearchRecord:
        plays = LongPlays(
            overload=lambda rate_hz: self.probe(rate_hz, "saturation"),
            confirm=lambda rate_hz, _: self.probe(rate_hz, "confirmation"),
            budget_s=60.0,
        )
        return PeakSearch(10.0, 400.0, 0.02, self.probe, long_plays=plays).run()


def test_a_disturbed_overload_shows_no_capacity() -> None:
    found = Overloaded("saturation", BUSY).search()
    overloads = [probe for probe in found.probes if probe.purpose == "saturation"]
    assert overloads
    assert all(overload.explained for overload in overloads)
    assert found.capacity is None
    # Short probes without interference found the upper end.
    assert found.fails_hz in [probe.rate_hz for probe in found.probes if not probe.explained]
    holds_hz, fails_hz = bracket(found)
    assert holds_hz <= 95.0 < fails_hz


def test_an_overload_that_was_hardly_disturbed_shows_the_capacity() -> None:
    found = Overloaded("saturation", Interference(BUSY.reasons, taken=0.009)).search()
    assert not any(probe.explained for probe in found.probes)
    assert any(probe.disturbed for probe in found.probes)
    assert found.capacity is not None


@pytest.mark.parametrize(
    ("seen", "reasons", "taken"),
    [
        ({"foreign_cores": 0.2, "own_waited": 0.3}, 0, 0.0),
        # The pressure of a probe near the peak is the graph's own.
        ({"foreign_cores": 0.1, "pressure": 0.9}, 0, 0.0),
        ({"foreign_cores": 1.7, "pressure": 0.9}, 1, 0.75),
        ({"foreign_cores": 0.6, "pressure": 0.9}, 1, 0.6),
        ({"foreign_cores": 1.7, "pressure": 0.9, "own_waited": 0.1, "own_cores": 0.2}, 1, 0.1),
        ({"steal": 0.1, "own_waited": 0.0}, 1, 0.2),
    ],
)
def test_what_is_said_of_a_part_of_a_run(seen: dict[str, Any], reasons: int, taken: float) -> None:
    found = interference_of(HostInterference(seconds=4.0, cores=2, **seen))
    assert len(found.reasons) == reasons
    assert found.taken == pytest.approx(taken)
