"""What is measured: the peak search, the rates to be sustained, the iterations.

The search and the probes of sustained rates are made in the first start. The iterations, those at
the peak among them, are spread over all starts (`r2bspec.plan.plan`).

All rates are played in each iteration, so that a slow drift of the machine affects them equally.
After each start from the fifth on there is an interim look, with the error probability divided
among them (`r2bspec.plan.interim_looks`). The run continues only while a requirement is undecided
that more iterations can decide.

After the last look, iterations affected by host interference are repeated, each once, while that
can change the outcome (`r2bspec.judge.affected_iterations`), in the start that then runs: the
record says which one that is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import msgspec

from r2bspec.execute.measurement.peak_search import PeakSearch
from r2bspec.execute.measurement.rate_probe import MAX_FUTILE_REPLAYS, RateProber
from r2bspec.execute.measurement.segments import SegmentHeading, SegmentPlayer, titled
from r2bspec.execute.run_context import RunContext
from r2bspec.execute.states import RunState
from r2bspec.judge.decision_policy import decide_after_look
from r2bspec.judge.methods import METHODS, Method
from r2bspec.judge.verdict import DisturbedIteration, Verdict
from r2bspec.plan.interim_looks import InterimLooks, iterations_of_starts
from r2bspec.plan.plan import Plan, PlayPlan
from r2bspec.record.run_record import ConfirmationRecord, HarnessOverheadRecord, Probe, SearchRecord


@dataclass
class Measurement:
    """The measurement of a run, or of its confirmation, and the results of its probes.

    Attributes:
        segment_player: plays in the start that runs.
    """

    plan: Plan
    segment_player: SegmentPlayer
    context: RunContext
    judge_so_far: Callable[[], Verdict]
    next_start: Callable[[], SegmentPlayer]
    _search: PeakSearch | None = None
    _sustained: list[Probe] = field(default_factory=list)
    _starts: list[SegmentPlayer] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.budget = self.context.budget
        self._prober = RateProber(self.plan, self.segment_player, self.context)
        self._plays: tuple[PlayPlan, ...] = self.plan.play

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

    def confirmation(
        self, harness_overhead: tuple[HarnessOverheadRecord, ...]
    ) -> ConfirmationRecord:
        """The record of a confirmation run with this harness overhead."""
        return ConfirmationRecord(
            search=self.search, sustained=self.sustained, harness_overhead=harness_overhead
        )

    def measure(self) -> tuple[Verdict, int]:
        """Measure what the plan requests.

        Returns:
            The verdict, and how many iterations were played at each rate.

        Raises:
            RunError: a process exited, failed, or does not respond.
        """
        self.budget.begin()
        self._probe_peak()
        self._probe_sustained()
        self._add_peak(self.peak_hz)
        if not self._plays:
            return self.judge_so_far(), 0
        self._enter_play()
        return self._play_until_decided()

    def measure_confirmation(
        self, failed: frozenset[Method], iterations: int, peak_hz: float | None
    ) -> None:
        """Measure again what the failed requirements depend on.

        Args:
            failed: the methods by which the failed requirements were decided.
            iterations: their number in the run; a run of one start plays as many again, and one of
                several starts as many as it takes.
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
        self._add_peak(self.peak_hz or peak_hz)
        if "iterations" in rests_on and self._plays:
            self._enter_play()
            if self.plan.starts == 1:
                self._play_start(range(1, iterations + 1), iterations)
                self._with_reruns(self.judge_so_far())
            else:
                self._play_until_decided()

    def _add_peak(self, peak_hz: float | None) -> None:
        """Play at the peak, too, if one was found that is not among the rates."""
        at_peak = self.plan.play_at_peak
        rates = [play.rate_hz for play in self.plan.play]
        if at_peak is not None and peak_hz is not None and peak_hz not in rates:
            self._plays = (*self.plan.play, msgspec.structs.replace(at_peak, rate_hz=peak_hz))

    def _probe_peak(self) -> None:
        search = self.plan.search
        if search is None:
            return
        self.context.states.enter(RunState.SEARCH, "searching for the peak rate")
        seconds = max(search.confirm_ns, search.probe_ns) / 1e9
        self._search = PeakSearch(
            search.min_hz,
            search.max_hz,
            search.precision,
            self._prober.probe,
            confidence=search.confidence,
            long_plays=self._prober.long_plays(
                search,
                lambda: self.budget.allows("the search ended early", seconds),
            ),
        )
        self._search.run()

    def _probe_sustained(self) -> None:
        if not self.plan.sustained_hz:
            return
        self.context.states.enter(RunState.SUSTAINED, "probing the rates to be sustained")
        for rate_hz in self.plan.sustained_hz:
            self._sustained.append(self._prober.probe_sustained(rate_hz).probe)

    def _enter_play(self) -> None:
        text = {"timeline": "playing the recording", "live": "recording the live graph"}
        state_text = text.get(self.plan.playback_mode, "playing at fixed rates")
        self.context.states.enter(RunState.PLAY, state_text)

    def _play_until_decided(self) -> tuple[Verdict, int]:
        """Play the iterations up to the look that decides."""
        looks = self._looks()
        began_s, played = self.budget.spent_s(), 0
        verdict: Verdict | None = None
        for iterations in self._iterations_of_starts():
            self._play_start(iterations, looks.iterations[-1])
            played = iterations[-1]
            if played not in looks.iterations:
                continue
            verdict = self.judge_so_far()
            counted = [
                requirement for requirement in verdict.requirements if requirement.level == "error"
            ]
            look = looks.completed_looks(played)
            if decide_after_look(looks, look, counted) != "go on":
                break
            more_s = (self.budget.spent_s() - began_s) / played * (looks.iterations[look] - played)
            if not self.budget.allows(f"no more than {played} iterations", more_s):
                break
            still_open = [
                requirement.text
                for requirement in counted
                if (requirement.outcome == "inconclusive" or requirement.early)
                and METHODS[requirement.method].rests_on == "iterations"
            ]
            if still_open:
                self.context.note(f"open after {played} iterations: {', '.join(still_open)}")
        return self._with_reruns(verdict or self.judge_so_far()), played

    def _iterations_of_starts(self) -> Iterator[range]:
        """The iterations of each start; those of the only start, up to each look."""
        looks, starts = self._looks(), self.plan.starts
        if starts == 1:
            for before, end in pairwise((0, *looks.iterations)):
                yield range(before + 1, end + 1)
        else:
            yield from iterations_of_starts(looks.declared, starts, looks.iterations[-1])

    def _looks(self) -> InterimLooks:
        return InterimLooks.with_end(self._plays, self.plan.starts)

    def _play_start(self, iterations: Iterable[int], end: int) -> None:
        """Play the iterations of a start: a new one if some were played in the one that runs."""
        if self._starts and self.plan.starts > 1:
            self.segment_player = self.next_start()
            self._enter_play()
        self._starts.append(self.segment_player)
        for index in iterations:
            for play in self._plays:
                self._play_once(play, index, f"iteration {index} of {end}")

    def _with_reruns(self, verdict: Verdict) -> Verdict:
        """The verdict, after the affected iterations on which it depends were repeated."""
        while iterations := iterations_to_rerun(verdict):
            iteration = iterations[0]
            name = iteration.segment
            play = next(
                candidate for candidate in self._plays if candidate.rate_hz == iteration.rate_hz
            )
            if not self.budget.allows(
                f"no rerun of {name}, which host interference affected", play.duration_ns / 1e9
            ):
                break
            reasons = "; ".join(iteration.reasons)
            self.context.note(f"host interference affected {name} ({reasons}): repeating it")
            segments = [segment for start in self._starts for segment in start.segments]
            index = next(segment.index for segment in segments if segment.id == name)
            self._play_once(play, index, f"iteration {index} again", rerun_of=name)
            verdict = self.judge_so_far()
        return verdict

    def _play_once(self, play: PlayPlan, index: int, title: str, rerun_of: str = "") -> None:
        again = "-again" if rerun_of else ""
        name = f"rate-{play.rate_hz:g}Hz" if play.rate_hz else "iteration"
        self.segment_player.play_for(
            SegmentHeading(
                kind="iteration",
                id=f"{name}-{index:03d}{again}",
                title=titled(play.rate_hz, title),
                index=index,
                rerun_of=rerun_of,
            ),
            play.rate_hz,
            play.duration_ns,
        )


def iterations_to_rerun(verdict: Verdict) -> Sequence[DisturbedIteration]:
    """The affected iterations that were not repeated yet and whose reruns can change the outcome.

    None can where a requirement fails anyway, or where the reruns so far were affected, too.
    """
    counted = [requirement for requirement in verdict.requirements if requirement.level == "error"]
    futile = sum(bool(iteration.rerun_of) for iteration in verdict.disturbed)
    if futile >= MAX_FUTILE_REPLAYS or any(
        requirement.outcome == "fail" for requirement in counted
    ):
        return []
    rates = [
        requirement.at_hz
        for requirement in counted
        if requirement.weakened and requirement.at_hz is not None
    ]
    return [
        iteration
        for iteration in verdict.disturbed
        if not iteration.rerun
        and not iteration.rerun_of
        and any(math.isclose(iteration.rate_hz, rate) for rate in rates)
    ]
