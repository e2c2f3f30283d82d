"""The measurement: the peak search, the rates to be sustained, the iterations.

The search and the probes of sustained rates are made in the first start. The iterations, including
those at the peak, are spread over all starts (`r2bspec.plan.plan`); those of one start are a unit
of the experiment (`r2bspec.execute.experiment`).

All rates are played in each iteration, so that a slow drift of the machine affects them equally.
After each start from the fifth on there is an interim look, with the error probability divided
among them (`r2bspec.plan.interim_looks`). The run continues only while a requirement is undecided
that more iterations can decide.

After the last look, iterations affected by host interference are repeated, each once, while that
can change the outcome (`r2bspec.judge.affected_iterations`), in the start that then runs: the
record says which one that is.

If the run fails, what the failure depends on is measured again in new processes, and judged alone
(`r2bspec.judge.confirmation`): in a run of one start as many iterations as failed, in one of
several starts as many starts as it takes.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import msgspec

from r2bspec.execute.experiment import Experiment, again, confirm, grow
from r2bspec.execute.measurement.peak_search import PeakSearch
from r2bspec.execute.measurement.rate_probe import MAX_FUTILE_REPLAYS, RateProber
from r2bspec.execute.run_context import RunContext
from r2bspec.execute.start.segments import SegmentHeading, SegmentPlayer, titled
from r2bspec.execute.start.start import StartSequence
from r2bspec.execute.states import RunState
from r2bspec.judge.methods import METHODS
from r2bspec.judge.verdict import DisturbedIteration, Verdict
from r2bspec.plan.interim_looks import InterimLooks, iterations_of_starts
from r2bspec.plan.plan import Plan, PlayPlan
from r2bspec.record.run_record import Probe, SearchRecord

_PLAY_TEXTS = {"timeline": "playing the recording", "live": "recording the live graph"}


class Iterations(NamedTuple):
    """A unit of a run: iterations that one start plays, one after the other.

    Attributes:
        indices: the indices of the iterations, from 1.
        plays: the rates, each of which is played in each iteration.
        rerun_of: the id of the segment in whose place the only one is played; empty otherwise.
    """

    indices: range
    plays: tuple[PlayPlan, ...]
    rerun_of: str = ""


@dataclass
class Batch:
    """The segments that were measured first, or again to confirm a failure.

    Attributes:
        prober: probes rates in the first start of the batch.
        plays: the rates of each iteration.
        starts: those that have played iterations, in their order.
        played: how many iterations.
    """

    prober: RateProber
    search: PeakSearch | None = None
    sustained: list[Probe] = field(default_factory=list)
    plays: tuple[PlayPlan, ...] = ()
    starts: list[SegmentPlayer] = field(default_factory=list)
    played: int = 0
    began_s: float = 0.0

    @property
    def search_record(self) -> SearchRecord | None:
        """The result of the search so far; None if there was none."""
        return self.search.record() if self.search else None

    @property
    def peak_hz(self) -> float | None:
        """The highest sustained rate of the search; None if there is none, or was no search."""
        record = self.search_record
        return record.holds_hz if record else None


class Measurement(Experiment[Iterations]):
    """The measurement of a run.

    Attributes:
        batches: the first one, and the one that confirms a failure, as far as they have begun.
    """

    def __init__(
        self,
        plan: Plan,
        context: RunContext,
        starts: StartSequence,
        judge: Callable[[Verdict | None], Verdict],
    ) -> None:
        """Prepare to measure.

        Args:
            plan: the plan of the run.
            context: the context of the run.
            starts: begins the starts.
            judge: judges what was measured so far; of a batch that confirms a failure, that batch
                alone, given the verdict that has failed.
        """
        self._plan, self._context, self._starts = plan, context, starts
        self._judge_so_far = judge
        self._failed: Verdict | None = None
        self._began_s = 0.0
        self.batches: list[Batch] = []

    def measure(self) -> None:
        """Measure what the plan requests.

        Raises:
            RunError: a process exited, failed, or does not respond.
        """
        self._began_s = time.monotonic()
        batch = self._begin_batch()
        self._context.budget.begin()
        self._probe_peak(batch)
        self._probe_sustained(batch)
        self._begin_iterations(batch, batch.peak_hz)
        self.carry_out(grow, again, confirm)
        self._starts.find_foreign_publishers()

    def begin_confirmation(self) -> bool:
        """Implement `Experiment`; probes that decided the failure are repeated here."""
        if not self._is_confirmed():
            return False
        failed = self._failed = self.verdict
        self._context.states.enter(
            RunState.CONFIRM, "the run fails: starting the confirmation run in new processes"
        )
        batch = self._begin_batch()
        rests_on = {
            METHODS[requirement.method].rests_on
            for requirement in failed.requirements
            if requirement.outcome == "fail"
        }
        if "search" in rests_on:
            self._probe_peak(batch)
        if "probes" in rests_on:
            self._probe_sustained(batch)
        if "iterations" in rests_on:
            self._begin_iterations(batch, batch.peak_hz or self.batches[0].peak_hz)
        return True

    def _is_confirmed(self) -> bool:
        """Return whether there is to be a confirmation run, after a failure."""
        # If others took part in what was measured, a fresh batch would confirm nothing.
        if not self._plan.gate.confirm or self._starts.find_foreign_publishers():
            return False
        if self._plan.external:
            self._context.note("no confirmation run: r2bspec cannot restart external nodes")
            return False
        took_s = time.monotonic() - self._began_s
        return self._context.budget.allows("no confirmation run", took_s)

    def _begin_batch(self) -> Batch:
        self._player = self._starts.begin(confirms=self._failed is not None)
        self.batches.append(Batch(RateProber(self._plan, self._player, self._context)))
        self._verdict = None
        return self.batches[-1]

    def _probe_peak(self, batch: Batch) -> None:
        search, budget = self._plan.search, self._context.budget
        if search is None:
            return
        self._context.states.enter(RunState.SEARCH, "searching for the peak rate")
        seconds = max(search.confirm_ns, search.probe_ns) / 1e9
        batch.search = PeakSearch(
            search.min_hz,
            search.max_hz,
            search.precision,
            batch.prober.probe,
            confidence=search.confidence,
            long_plays=batch.prober.long_plays(
                search, lambda: budget.allows("the search ended early", seconds)
            ),
        )
        batch.search.run()

    def _probe_sustained(self, batch: Batch) -> None:
        if not self._plan.sustained_hz:
            return
        self._context.states.enter(RunState.SUSTAINED, "probing the rates to be sustained")
        for rate_hz in self._plan.sustained_hz:
            batch.sustained.append(batch.prober.probe_sustained(rate_hz).probe)

    def _begin_iterations(self, batch: Batch, peak_hz: float | None) -> None:
        """Play the rates of the plan, and the peak, if one was found that is not among them."""
        at_peak, batch.plays = self._plan.play_at_peak, self._plan.play
        rates = [play.rate_hz for play in batch.plays]
        if at_peak is not None and peak_hz is not None and peak_hz not in rates:
            batch.plays = (*batch.plays, msgspec.structs.replace(at_peak, rate_hz=peak_hz))
        if batch.plays:
            self._enter_play()
        batch.began_s = self._context.budget.spent_s()

    def _enter_play(self) -> None:
        text = _PLAY_TEXTS.get(self._plan.playback_mode, "playing at fixed rates")
        self._context.states.enter(RunState.PLAY, text)

    @property
    def _confirms_in_one_start(self) -> bool:
        return self._failed is not None and self._plan.starts == 1

    @property
    def looks(self) -> InterimLooks | None:
        """As in `Experiment`."""
        plays = self.batches[-1].plays
        if not plays or self._confirms_in_one_start:
            return None
        return InterimLooks.with_end(plays, self._plan.starts)

    def planned(self) -> Sequence[Iterations]:
        """Return the iterations of each start; with one start, those up to each look."""
        plays, looks, starts = self.batches[-1].plays, self.looks, self._plan.starts
        if not plays:
            return []
        if looks is None:
            return [Iterations(range(1, self.batches[0].played + 1), plays)]
        if starts == 1:
            ends = pairwise((0, *looks.iterations))
            return [Iterations(range(before + 1, end + 1), plays) for before, end in ends]
        parts = iterations_of_starts(looks.declared, starts, looks.iterations[-1])
        return [Iterations(part, plays) for part in parts]

    def play(self, unit: Iterations) -> None:
        """Play iterations; in a new start if the current start has already played some."""
        batch, is_rerun = self.batches[-1], bool(unit.rerun_of)
        if not is_rerun:
            if batch.starts and self._plan.starts > 1:
                self._player = self._starts.begin(confirms=self._failed is not None)
                self._enter_play()
            batch.starts.append(self._player)
            batch.played = unit.indices[-1]
        end = self.looks.iterations[-1] if self.looks else unit.indices[-1]
        for index in unit.indices:
            for play in unit.plays:
                name = f"rate-{play.rate_hz:g}Hz" if play.rate_hz else "iteration"
                title = f"iteration {index} again" if is_rerun else f"iteration {index} of {end}"
                self._player.play_for(
                    SegmentHeading(
                        kind="iteration",
                        id=f"{name}-{index:03d}{'-again' if is_rerun else ''}",
                        title=titled(play.rate_hz, title),
                        index=index,
                        rerun_of=unit.rerun_of,
                    ),
                    play.rate_hz,
                    play.duration_ns,
                )

    def complete(self) -> int:
        """Return the number of complete iterations."""
        return self.batches[-1].played

    def _judge(self) -> Verdict:
        return self._judge_so_far(self._failed)

    def has_time(self, *, was_judged: bool) -> bool:
        """Implement `Experiment`: between two looks, all iterations are completed."""
        looks, batch, budget = self.looks, self.batches[-1], self._context.budget
        if not was_judged or looks is None:
            return True
        next_look = looks.iterations[looks.completed_looks(batch.played)]
        per_iteration_s = (budget.spent_s() - batch.began_s) / batch.played
        more_s = per_iteration_s * (next_look - batch.played)
        if not budget.allows(f"no more than {batch.played} iterations", more_s):
            return False
        still_open = [
            requirement.text
            for requirement in self.counted()
            if (requirement.outcome == "inconclusive" or requirement.early)
            and METHODS[requirement.method].rests_on == "iterations"
        ]
        if still_open:
            self._context.note(f"open after {batch.played} iterations: {', '.join(still_open)}")
        return True

    def affected(self) -> Iterations | None:
        """Return one disturbed iteration at one rate."""
        batch = self.batches[-1]
        if not batch.plays or not (iterations := iterations_to_rerun(self.verdict)):
            return None
        iteration = iterations[0]
        name = iteration.segment
        play = next(play for play in batch.plays if play.rate_hz == iteration.rate_hz)
        if not self._context.budget.allows(
            f"no rerun of {name}, which host interference affected", play.duration_ns / 1e9
        ):
            return None
        reasons = "; ".join(iteration.reasons)
        self._context.note(f"host interference affected {name} ({reasons}): repeating it")
        segments = [segment for start in batch.starts for segment in start.segments]
        index = next(segment.index for segment in segments if segment.id == name)
        return Iterations(range(index, index + 1), (play,), rerun_of=name)


def iterations_to_rerun(verdict: Verdict) -> Sequence[DisturbedIteration]:
    """Return disturbed iterations, not yet repeated, whose repetition can change the outcome.

    There are none if a requirement fails anyway, or if the repetitions so far were disturbed, too.
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
