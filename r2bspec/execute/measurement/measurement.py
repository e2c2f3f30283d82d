"""What is measured in a batch: the search for the peak, the rates to be sustained, iterations."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from r2bspec.execute.measurement.iterations import IterationRunner
from r2bspec.execute.measurement.peak_search import PeakSearch
from r2bspec.execute.measurement.rate_probe import RateProber
from r2bspec.execute.measurement.run_reporter import RunReporter
from r2bspec.execute.measurement.segments import SegmentPlayer
from r2bspec.execute.measurement.time_budget import TimeBudget
from r2bspec.judge.methods.method_registry import METHODS, Method
from r2bspec.judge.verdict import Verdict
from r2bspec.plan.plan import Plan
from r2bspec.record.run_record import ConfirmationRecord, FloorRecord, Probe, SearchRecord


class Measurement:
    """The measuring of one batch, and what its probes found."""

    def __init__(
        self,
        plan: Plan,
        segment_player: SegmentPlayer,
        reporter: RunReporter,
        judge_so_far: Callable[[], Verdict],
        budget: TimeBudget,
    ) -> None:
        """Measure on a stage.

        Args:
            plan: of the run.
            segment_player: where to play.
            reporter: is told what happens.
            judge_so_far: the verdict on everything that was played in the batch.
            budget: of the whole run.
        """
        self._plan = plan
        self._segment_player = segment_player
        self._reporter = reporter
        self._prober = RateProber(plan, segment_player, reporter.note)
        self._judge_so_far = judge_so_far
        self._budget = budget
        self._search: PeakSearch | None = None
        self._sustained: list[Probe] = []

    @property
    def search(self) -> SearchRecord | None:
        """What the search has found so far; None if there was none."""
        return self._search.record() if self._search else None

    @property
    def peak_hz(self) -> float | None:
        """The highest rate that held in the search; None if none did, or there was no search."""
        return self.search.holds_hz if self.search else None

    @property
    def sustained(self) -> tuple[Probe, ...]:
        """The probes of rates to be sustained."""
        return tuple(self._sustained)

    def confirmation(self, floor: tuple[FloorRecord, ...]) -> ConfirmationRecord:
        """What was found, in a batch that confirms and has that floor."""
        return ConfirmationRecord(search=self.search, sustained=self.sustained, floor=floor)

    def measure(self) -> tuple[Verdict, int]:
        """Measure what the plan says.

        Returns:
            The verdict, and how many iterations were played at each rate.

        Raises:
            RunError: a process died, failed, or does not answer.
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
        """Measure what a failure rests on.

        Args:
            failed: how the requirements that failed were decided.
            iterations: how many there were when they failed.
            peak_hz: the peak that was found then; what is played at the peak is played there,
                unless this batch finds one of its own.

        Raises:
            RunError: a process died, failed, or does not answer.
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
        return IterationRunner(
            plan, self._segment_player, self._judge_so_far, self._reporter.note, self._budget
        )

    def _plan_with_peak(self, peak_hz: float | None) -> Plan:
        """The plan with what is to be played at the peak among its rates, where one was found."""
        asked = self._plan.play_at_peak
        if (
            asked is None
            or peak_hz is None
            or any(each.rate_hz == peak_hz for each in self._plan.play)
        ):
            return self._plan
        play = msgspec.structs.replace(asked, rate_hz=peak_hz)
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
        )
        self._search.run()

    def _probe_sustained(self) -> None:
        if not self._plan.sustained_hz:
            return
        self._reporter.phase("sustained", "probing the rates to be sustained")
        for rate_hz in self._plan.sustained_hz:
            self._sustained.append(self._prober.probe_sustained(rate_hz).probe)


def _phase_text(plan: Plan) -> str:
    return {"timeline": "playing the recording", "live": "watching the graph"}.get(
        plan.playback_mode, "playing at fixed rates"
    )
