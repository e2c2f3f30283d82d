"""What is measured: the peak search, the rates to be sustained, the iterations.

The search and the probes of sustained rates are made in the first start. The iterations, those at
the peak among them, are spread over all starts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import msgspec

from r2bspec.execute.measurement.affected_probes import (
    AffectedProbes,
)
from r2bspec.execute.measurement.iterations import IterationRunner
from r2bspec.execute.measurement.peak_search import PeakSearch
from r2bspec.execute.measurement.rate_probe import DEFAULT_PRECISION, RateProber
from r2bspec.execute.measurement.run_reporter import RunReporter
from r2bspec.execute.measurement.segments import SegmentPlayer
from r2bspec.execute.measurement.time_budget import TimeBudget
from r2bspec.judge.methods.method_registry import METHODS, Method
from r2bspec.judge.verdict import Verdict
from r2bspec.plan.plan import Plan
from r2bspec.record.run_record import ConfirmationRecord, FloorRecord, Probe, SearchRecord


class Measurement:
    """The measurement of a run, or of its confirmation, and the results of its probes."""

    def __init__(
        self,
        plan: Plan,
        segment_player: SegmentPlayer,
        reporter: RunReporter,
        judge_so_far: Callable[[], Verdict],
        budget: TimeBudget,
        next_start: Callable[[], SegmentPlayer],
        lost_rates: Callable[[], Mapping[float, str]] | None = None,
    ) -> None:
        """Create the measurement; nothing is played yet.

        Args:
            plan: of the run.
            segment_player: plays the segments of the first start.
            reporter: receives phases and notes.
            judge_so_far: the verdict on everything that was measured.
            budget: of the whole run.
            next_start: starts all processes afresh; what it returns plays from then on.
            lost_rates: see `IterationRunner`.
        """
        self._plan = plan
        self._segment_player = segment_player
        self._reporter = reporter
        disturbed = AffectedProbes(
            plan.gate.interference,
            plan.search.precision if plan.search else DEFAULT_PRECISION,
            lambda: segment_player.segments[-1],
            reporter.host.between,
            budget,
            reporter.note,
        )
        self._prober = RateProber(plan, segment_player, reporter.note, disturbed.play)
        self._judge_so_far = judge_so_far
        self._budget = budget
        self._next_start = next_start
        self._lost_rates = lost_rates
        self._search: PeakSearch | None = None
        self._sustained: list[Probe] = []

    @property
    def search(self) -> SearchRecord | None:
        """The result of the search so far; None if there was none."""
        return self._search.record() if self._search else None

    @property
    def peak_hz(self) -> float | None:
        """The highest sustained rate of the search; None if there is none, or was no search."""
        return self.search.holds_hz if self.search else None

    @property
    def sustained(self) -> tuple[Probe, ...]:
        """The probes of rates to be sustained."""
        return tuple(self._sustained)

    def confirmation(self, floor: tuple[FloorRecord, ...]) -> ConfirmationRecord:
        """The record of a confirmation run with this harness overhead."""
        return ConfirmationRecord(search=self.search, sustained=self.sustained, floor=floor)

    def measure(self) -> tuple[Verdict, int]:
        """Measure what the plan requests.

        Returns:
            The verdict, and how many iterations were played at each rate.

        Raises:
            RunError: a process exited, failed, or does not respond.
        """
        self._budget.begin()
        self._probe_peak()
        self._probe_sustained()
        plan = self._plan_with_peak(self.peak_hz)
        if not plan.play:
            return self._judge_so_far(), 0
        self._reporter.phase("play", _phase_text(plan))
        return self._iteration_runner(plan).play()

    def measure_confirmation(
        self, failed: frozenset[Method], iterations: int, peak_hz: float | None
    ) -> None:
        """Measure again what the failed requirements depend on.

        Args:
            failed: the methods by which the failed requirements were decided.
            iterations: their number in the run.
            peak_hz: the peak of the run, at which `play_at_peak` is played unless the confirmation
                finds its own peak.

        Raises:
            RunError: a process exited, failed, or does not respond.
        """
        rests_on = {METHODS[method].rests_on for method in failed}
        if "search" in rests_on:
            self._probe_peak()
        if "probes" in rests_on:
            self._probe_sustained()
        plan = self._plan_with_peak(self.peak_hz or peak_hz)
        if "iterations" in rests_on and plan.play:
            self._reporter.phase("play", _phase_text(plan))
            self._iteration_runner(plan).play_fixed_number(iterations)

    def _iteration_runner(self, plan: Plan) -> IterationRunner:
        def next_start() -> SegmentPlayer:
            segment_player = self._next_start()
            self._reporter.phase("play", _phase_text(plan))
            return segment_player

        return IterationRunner(
            plan,
            self._segment_player,
            self._judge_so_far,
            self._reporter.note,
            self._budget,
            next_start,
            self._lost_rates,
        )

    def _plan_with_peak(self, peak_hz: float | None) -> Plan:
        """The plan with the peak, if one was found, among its rates."""
        at_peak = self._plan.play_at_peak
        if (
            at_peak is None
            or peak_hz is None
            or any(each.rate_hz == peak_hz for each in self._plan.play)
        ):
            return self._plan
        play = msgspec.structs.replace(at_peak, rate_hz=peak_hz)
        return msgspec.structs.replace(self._plan, play=(*self._plan.play, play))

    def _probe_peak(self) -> None:
        wanted = self._plan.search
        if wanted is None:
            return
        self._reporter.phase("search", "searching for the peak rate")
        self._search = PeakSearch(
            wanted.min_hz,
            wanted.max_hz,
            wanted.precision,
            self._prober.probe,
            confidence=wanted.confidence,
            long_plays=self._prober.long_plays(self._allows_more(wanted.confirm_ns / 1e9)),
        )
        self._search.run()

    def _allows_more(self, seconds: float) -> Callable[[float], bool]:
        """Whether the time budget has room to play one more rate whole."""

        def allows(rate_hz: float) -> bool:
            return self._budget.allows(f"{rate_hz:.4g} Hz was not played whole", seconds)

        return allows

    def _probe_sustained(self) -> None:
        if not self._plan.sustained_hz:
            return
        self._reporter.phase("sustained", "probing the rates to be sustained")
        for rate_hz in self._plan.sustained_hz:
            self._sustained.append(self._prober.probe_sustained(rate_hz).probe)


def _phase_text(plan: Plan) -> str:
    return {"timeline": "playing the recording", "live": "recording the live graph"}.get(
        plan.playback_mode, "playing at fixed rates"
    )
