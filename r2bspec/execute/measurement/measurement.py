"""What is measured: the peak search, the rates to be sustained, the iterations.

The search and the probes of sustained rates are made in the first start. The iterations, those at
the peak among them, are spread over all starts (`r2bspec.plan.plan`).

All rates are played in each iteration, so that a slow drift of the machine affects them equally. If
the spec allows more iterations than it declares, there are interim looks after one, two and four
times the declared number, with the error probability divided among them
(`r2bspec.judge.decision_policy`). The run continues only while a requirement is undecided that more
iterations can decide.

At each look, iterations affected by host interference are repeated, each once, if that decides
whether a failure counts (`r2bspec.judge.affected_iterations`), in the start that then runs: the
record says which one that is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import msgspec

from r2bspec.execute.measurement.peak_search import PeakSearch
from r2bspec.execute.measurement.rate_probe import DEFAULT_PRECISION, AffectedProbes, RateProber
from r2bspec.execute.measurement.segments import SegmentHeading, SegmentPlayer
from r2bspec.execute.run_context import RunContext, TimeBudget
from r2bspec.execute.states import RunState
from r2bspec.judge.decision_policy import InterimLooks, decide_after_look, decision_policy
from r2bspec.judge.methods import METHODS, Method
from r2bspec.judge.verdict import DisturbedIteration, Verdict
from r2bspec.plan.plan import Plan, PlayPlan, iterations_by_look
from r2bspec.record.run_record import (
    ConfirmationRecord,
    EndedRate,
    HarnessOverheadRecord,
    Probe,
    SearchRecord,
)


class Measurement:
    """The measurement of a run, or of its confirmation, and the results of its probes."""

    def __init__(
        self,
        plan: Plan,
        segment_player: SegmentPlayer,
        context: RunContext,
        judge_so_far: Callable[[], Verdict],
        budget: TimeBudget,
        next_start: Callable[[], SegmentPlayer],
        lost_rates: Callable[[], Mapping[float, str]] | None = None,
    ) -> None:
        """Create the measurement; nothing is played yet.

        Args:
            plan: of the run.
            segment_player: plays the segments of the first start.
            context: of the run.
            judge_so_far: the verdict on everything that was measured.
            budget: of the whole run.
            next_start: starts all processes afresh; what it returns plays from then on.
            lost_rates: see `IterationRunner`.
        """
        self._plan = plan
        self._segment_player = segment_player
        self._context = context
        disturbed = AffectedProbes(
            plan.gate.interference,
            plan.search.precision if plan.search else DEFAULT_PRECISION,
            lambda: segment_player.segments[-1],
            context.host.between,
            budget,
            context.note,
        )
        self._prober = RateProber(plan, segment_player, context.note, disturbed.play)
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
        self._budget.begin()
        self._probe_peak()
        self._probe_sustained()
        plan = self._plan_with_peak(self.peak_hz)
        if not plan.play:
            return self._judge_so_far(), 0
        self._enter_play(plan)
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
            self._enter_play(plan)
            self._iteration_runner(plan).play_fixed_number(iterations)

    def _enter_play(self, plan: Plan) -> None:
        text = {"timeline": "playing the recording", "live": "recording the live graph"}
        state_text = text.get(plan.playback_mode, "playing at fixed rates")
        self._context.states.enter(RunState.PLAY, state_text)

    def _iteration_runner(self, plan: Plan) -> IterationRunner:
        def next_start() -> SegmentPlayer:
            segment_player = self._next_start()
            self._enter_play(plan)
            return segment_player

        return IterationRunner(
            plan,
            self._segment_player,
            self._judge_so_far,
            self._context.note,
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
        self._context.states.enter(RunState.SEARCH, "searching for the peak rate")
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
        self._context.states.enter(RunState.SUSTAINED, "probing the rates to be sustained")
        for rate_hz in self._plan.sustained_hz:
            self._sustained.append(self._prober.probe_sustained(rate_hz).probe)


@dataclass
class IterationRunner:
    """Plays the iterations of a plan.

    Attributes:
        segment_player: plays in the start that runs.
        judge_so_far: the verdict on everything that has been played.
        note: receives notes on the decisions.
        budget: limits everything that is played in addition to the declared iterations.
        next_start: starts all processes afresh; what it returns plays from then on.
        lost_rates: with ``--abort-on-fail``, the rates whose requirements can no longer be met,
            each with a sentence; None plays everything.
    """

    plan: Plan
    segment_player: SegmentPlayer
    judge_so_far: Callable[[], Verdict]
    note: Callable[[str], None]
    budget: TimeBudget
    next_start: Callable[[], SegmentPlayer]
    lost_rates: Callable[[], Mapping[float, str]] | None = None
    _ended: dict[float, str] = field(default_factory=dict)
    _starts: list[SegmentPlayer] = field(default_factory=list)
    """Those in which iterations were played."""

    def play(self) -> tuple[Verdict, int]:
        """Play the iterations up to the look that decides.

        Returns:
            The verdict, and how many iterations were played at each rate.

        Raises:
            RunError: from `SegmentPlayer.play`.
        """
        looks = self._looks()
        began_s, played = self.budget.spent_s(), 0
        groups = iterations_by_look(looks.iterations, self.plan.starts)
        for number, end in enumerate(looks.iterations, start=1):
            for iterations in groups[number - 1]:
                if not self._all_ended:
                    self._play_start(iterations, end)
            played = end
            verdict = self._judge()
            if self._all_ended:
                played = self._most_iterations()
                break
            if number == len(looks) or not _needs_more(verdict, looks, number):
                break
            each_s = (self.budget.spent_s() - began_s) / played
            more_s = each_s * (looks.iterations[number] - played)
            if not self.budget.allows(f"no more than {end} iterations", more_s):
                break
            self.note(f"not all requirements are decided after {end} iterations: playing more")
        return verdict, played

    def play_fixed_number(self, number: int) -> Verdict:
        """Play as many iterations as `play` did, in as many starts.

        Args:
            number: of iterations at each rate, as `play` returned it.

        Raises:
            RunError: from `SegmentPlayer.play`.
        """
        groups = iterations_by_look(self._looks().iterations, self.plan.starts)
        for iterations in (each for group in groups for each in group):
            wanted = [index for index in iterations if index <= number]
            if wanted:
                self._play_start(wanted, number)
        return self._judge()

    def _looks(self) -> InterimLooks:
        declared = max(each.iterations for each in self.plan.play)
        return decision_policy(self.plan).looks or InterimLooks((declared,))

    def _play_start(self, iterations: Iterable[int], end: int) -> None:
        """Play the iterations of a start: a new one if some were played in the one that runs."""
        if self._starts and self.plan.starts > 1:
            self.segment_player = self.next_start()
        self._starts.append(self.segment_player)
        for index in iterations:
            for play in self.plan.play:
                if play.rate_hz not in self._ended:
                    self._play_once(play, index, f"iteration {index} of {end}")
            if self.lost_rates is not None and index < end:
                self._end_lost_rates(index, end)
            if self._all_ended:
                return

    @property
    def _all_ended(self) -> bool:
        return all(each.rate_hz in self._ended for each in self.plan.play)

    def _most_iterations(self) -> int:
        """The largest number of iterations that a rate has; those of a confirmation run."""
        return max(each.index for each in self.segment_player.segments if each.kind == "iteration")

    def _end_lost_rates(self, index: int, end: int) -> None:
        """End the rates with a requirement that no rest can make pass."""
        assert self.lost_rates is not None  # noqa: S101 - see the caller
        for rate_hz, why in self.lost_rates().items():
            if rate_hz in self._ended or rate_hz not in {each.rate_hz for each in self.plan.play}:
                continue
            at = f"{rate_hz:g} Hz" if rate_hz else "the recording"
            sentence = f"{at} was ended after {index} of {end} iterations: {why}"
            self._ended[rate_hz] = sentence
            self.budget.ended_rates.append(EndedRate(rate_hz=rate_hz, iterations=index))
            self.budget.leave_out(sentence)

    def _judge(self) -> Verdict:
        """The verdict, after the affected iterations on which it depends were repeated."""
        verdict = self.judge_so_far()
        wanted = iterations_to_rerun(verdict)
        again = 0
        for one in wanted:
            play = next(each for each in self.plan.play if each.rate_hz == one.rate_hz)
            if not self.budget.allows(
                f"no rerun of {one.segment}, which host interference affected",
                play.duration_ns / 1e9,
            ):
                break
            reasons = "; ".join(one.reasons)
            self.note(f"host interference affected {one.segment} ({reasons}): repeating it")
            index = next(
                each.index
                for start in self._starts
                for each in start.segments
                if each.id == one.segment
            )
            self._play_once(play, index, f"iteration {index} again", rerun_of=one.segment)
            again += 1
        return self.judge_so_far() if again else verdict

    def _play_once(self, play: PlayPlan, index: int, title: str, rerun_of: str = "") -> None:
        again = "-again" if rerun_of else ""
        at = f"{play.rate_hz:g} Hz, " if play.rate_hz else ""
        name = f"rate-{play.rate_hz:g}Hz" if play.rate_hz else "iteration"
        self.segment_player.play_for(
            SegmentHeading(
                "iteration", f"{name}-{index:03d}{again}", f"{at}{title}", index, rerun_of
            ),
            play.rate_hz,
            play.duration_ns,
        )


def iterations_to_rerun(verdict: Verdict) -> Sequence[DisturbedIteration]:
    """The affected iterations on which a failure depends, and that were not repeated yet."""
    rates = {one.at_hz for one in verdict.requirements if one.weakened and one.at_hz is not None}
    return [
        one
        for one in verdict.disturbed
        if not one.rerun
        and not one.rerun_of
        and any(math.isclose(one.rate_hz, rate) for rate in rates)
    ]


def _needs_more(verdict: Verdict, looks: InterimLooks, number: int) -> bool:
    """Whether a requirement is undecided after a look that more iterations can decide."""
    counted = [each for each in verdict.requirements if each.level == "error"]
    return decide_after_look(looks, number, counted) == "go on"
