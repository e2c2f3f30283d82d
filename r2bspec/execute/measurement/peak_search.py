"""The peak search: the highest offered rate that is sustained, to a given relative precision.

The search is independent of processes: it calls functions that play, and evaluates their outcomes.

1. Both ends of the range are probed. The output rate of an overloaded graph is close to the rate
   that it can sustain.
2. The graph is overloaded, some seconds at a time, until its capacity is known to the precision
   (`r2bspec.judge.stationarity`): once by 30 %, then by 7 %, because a graph may be slower the more
   it is overloaded. That bounds the peak from above, and says where to look for it.
3. Where conditions or large tolerated losses decide, or it cannot be overloaded, the bracket is
   narrowed by short probes: near the output rate of the overload first, then in growing strides,
   then by halves of the ratio of its ends.
4. The lower end is played whole. If that refutes it, the search goes on below.
5. The upper end is played, too. If the graph keeps up with it, it is raised.
6. The lower end is played once more: if it is not sustained any more, the machine has become slower
   meanwhile, and the search goes on below with what it has learnt.

The search has a time; when that is over, nothing is played but what a bracket needs.

A probe may be undecided, if the times of the graph vary too much for its length. The ends of
the bracket then approach this rate by halves, and the final bracket is wider than the precision,
which the record shows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field

from r2bspec.judge.stationarity import (
    Capacity,
    CompletionTimes,
    estimate_capacity,
    find_nonstationarity,
    find_start,
)
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.record.run_record import CapacityRecord, Limit, Probe, Proof, SearchRecord

_FACTORS = (1.3, 1.07)
"""The offered rates as multiples of what comes out: of the first play, clearly too much; of all
others, not much more, because graphs that are drowned in messages are slower. The capacity comes
from these; the first shows how much slower the graph is with more."""

_MORE = 1.1
"""A play is harder than another if it offers so many times as much."""

_MAX_UNSATURATED = 4
"""So many plays may turn out not to overload the graph; each next one offers more."""


_STRIDE_GROWTH = 4.0
"""Strides of 1, 4 and 16 times the precision: after a good guess the first one ends the search; a
bad guess is corrected after two or three."""


_MAX_OPEN_PROBES = 8
"""Undecided probes are the longest ones; after this number the search ends."""


_MAX_RAISES = 3
"""So often the upper end is raised; then it is the lowest rate that was not sustained."""

_KEPT_UP = 0.998
"""A graph out of which this share of the upper end comes keeps up with it."""


_MAX_CONFIRMATIONS = 3
"""So many rates are played whole; if none of them is confirmed, the search ends without a proof."""


@dataclass(frozen=True)
class ProbeOutcome:
    """The result of one probe.

    Attributes:
        probe: for the record.
        limited_by_player: the rate was not sustained because the player could not offer it, which
            is no property of the graph.
        departures: when the outputs left, of the monitor that does worst; None if unknown.
        drop_share: the share of the completed outputs that never arrived.
    """

    probe: Probe
    limited_by_player: bool = False
    departures: CompletionTimes | None = None
    drop_share: float = 0.0

    @property
    def sustained(self) -> bool | None:
        """Whether the rate is sustained, as far as the next rate depends on it.

        A rate that keeps up counts, even if too few messages were played to bound the losses.
        """
        return True if self.probe.keeps_up and self.probe.holds is None else self.probe.holds


ProbeFunction = Callable[[float], ProbeOutcome]


@dataclass(frozen=True)
class LongPlays:
    """The parts of a search other than short probes.

    Attributes:
        overload: plays a rate that is too high, for some seconds; None if there is none.
        confirm: plays the lower end whole; the second argument is the rate up to which the
            capacity is proven. None if the lower end is not confirmed.
        upper: plays the upper end, until it is clear that it is not sustained; the second argument
            is in how many seconds that should be. None to trust it.
        budget_s: overloaded playing ends after so many seconds, whether they counted or not.
        search_s: after so many seconds of playing, nothing is played but what a bracket needs: both
            ends of the range, two overloads, and both ends of the bracket.
        stages: how many queues there may be in a row.
        loss: the share that may be lost; a graph with bounded queues sustains more because of it.
        conditions: whether other conditions than lost messages decide what is sustained.
        allows: whether there is time for more than that.
    """

    overload: ProbeFunction | None = None
    confirm: Callable[[float, float], ProbeOutcome] | None = None
    upper: Callable[[float, float], ProbeOutcome] | None = None
    budget_s: float = 0.0
    search_s: float = math.inf
    stages: int = 1
    loss: float = 0.0
    conditions: bool = False
    allows: Callable[[], bool] = lambda: True

    def needs_probes(self, precision: float) -> bool:
        """Return True if the capacity alone does not determine the peak to this precision."""
        return self.conditions or self.loss > precision


SHORT_PROBES = LongPlays()
"""Nothing but short probes."""


@dataclass
class Overload:
    """The overloaded plays of one search, and the capacity that they show.

    Attributes:
        play: plays a rate for the usual length of an overloaded play.
        max_hz: the highest rate of the search.
        precision: the relative width to which the capacity is estimated.
        confidence: the confidence of the interval.
        long_plays: the long plays of the search.
        goes_on: whether there is time for more than two plays that count.
        plays: those by which the capacity is estimated.
        shown: all that were played, to be examined for steadiness.
    """

    play: Callable[[float], CompletionTimes | None]
    max_hz: float
    precision: float
    confidence: float
    long_plays: LongPlays
    goes_on: Callable[[], bool] = lambda: True
    plays: list[CompletionTimes] = field(default_factory=list)
    shown: list[CompletionTimes] = field(default_factory=list)
    capacity: Capacity | None = None

    @property
    def played_s(self) -> float:
        """The seconds of the plays that count."""
        return sum(play.played_s for play in self.plays)

    def run(self, guess_hz: float) -> Capacity | None:
        """Overload the graph until its capacity is known to the precision, or the time is over.

        Args:
            guess_hz: what came out of a first overload, in steps per second.

        Returns:
            None if the graph could not be overloaded, or too few outputs came.
        """
        rate_hz, kept_up, spent_s = min(guess_hz * _FACTORS[0], self.max_hz), 0, 0.0
        while spent_s < self.long_plays.budget_s and (
            len(self.plays) < len(_FACTORS) or self.goes_on()
        ):
            play = self.play(rate_hz)
            if play is None:
                return None
            spent_s += play.played_s
            if not play.saturated:
                kept_up += 1
                if self.capacity is not None and rate_hz > self.capacity.upper_hz:
                    # With less overload it is faster than with more, by more than was estimated.
                    self.capacity = None
                if kept_up >= _MAX_UNSATURATED or rate_hz >= self.max_hz:
                    return None
                # With less overload it may be faster than with more.
                more_hz = min((play.offered_hz / play.per_step for play in self.plays), default=0.0)
                rate_hz = min(math.sqrt(rate_hz * more_hz) or rate_hz * _FACTORS[0], self.max_hz)
                continue
            self.add(play)
            if self.capacity is not None:
                if self.harder and self.capacity.gentle_width <= self.precision:
                    break
                rate_hz = min(self.capacity.hz * _FACTORS[1], self.max_hz)
        return self.capacity

    @property
    def tells_after_s(self) -> float:
        """How long to play, in seconds, to resolve half the requested precision.

        A quarter of the plays suffices for half the precision in either direction.
        """
        if self.capacity is None:
            return math.inf
        seconds = sum(play.played_s for play in self.gentle)
        return 4 * seconds * (self.capacity.gentle_width / self.precision) ** 2

    @property
    def gentle(self) -> list[CompletionTimes]:
        """The plays with the least overload."""
        least_hz = min((play.offered_hz for play in self.plays), default=0.0)
        return [play for play in self.plays if play.offered_hz < least_hz * _MORE]

    @property
    def harder(self) -> list[CompletionTimes]:
        """The plays with clearly more overload than the others."""
        least_hz = min((play.offered_hz for play in self.plays), default=0.0)
        return [play for play in self.plays if play.offered_hz >= least_hz * _MORE]

    @property
    def comparable(self) -> list[CompletionTimes]:
        """The plays that show whether the graph is steady: it may be slower the more is offered."""
        if self.capacity is None or self.capacity.drowns <= self.precision / 4:
            return self.shown
        harder = self.harder
        return [play for play in self.shown if play not in harder]

    def add(self, play: CompletionTimes, *, shown: bool = True) -> None:
        """Count a play in which the graph was overloaded."""
        self.plays.append(play)
        if shown:
            self.shown.append(play)
        self.capacity = estimate_capacity(
            self.gentle, self.confidence, stages=self.long_plays.stages, harder=self.harder
        )

    def learn(self, play: CompletionTimes) -> None:
        """Use a play that was meant to confirm a rate, and refuted it.

        Its second half shows the graph when it no longer keeps up. If the earlier plays have
        measured the graph during a faster beginning, only this half counts from now on.
        """
        self.shown.append(play)
        later = play.after(play.played_s / 2)
        started = find_start(self.shown, self.precision)
        if started is not None:
            self.plays = []
        self.add(later, shown=False)

    def record(self) -> CapacityRecord | None:
        """Return the capacity as the run record has it."""
        if self.capacity is None:
            return None
        upper_hz = self.capacity.upper_hz
        return CapacityRecord(
            hz=self.capacity.hz,
            lower_hz=self.capacity.lower_hz,
            upper_hz=upper_hz if math.isfinite(upper_hz) else None,
            played_s=self.played_s,
        )

    @property
    def proven_hz(self) -> float:
        """The lower bound of the capacity; 0 if nothing is known."""
        return self.capacity.lower_hz if self.capacity is not None else 0.0

    @property
    def upper_hz(self) -> float | None:
        """The upper end of the bracket.

        At least half the precision above the estimate, because a saturated graph and one that just
        keeps up differ, and as much more as lost messages allow.
        """
        if self.capacity is None:
            return None
        loss = self.long_plays.loss
        return self._bound_hz(self.capacity) / (1 - loss) if loss < 1 else None

    @property
    def lower_hz(self) -> float | None:
        """The lower end at which the bracket should be proven."""
        if self.capacity is None:
            return None
        return min(self.capacity.lower_hz, self._bound_hz(self.capacity) / (1 + self.precision))

    def _bound_hz(self, capacity: Capacity) -> float:
        return max(capacity.upper_hz, capacity.hz * (1 + self.precision / 2))


@dataclass
class PeakSearch:
    """One search; `run` executes it, `record` is its current state.

    Attributes:
        minimum_hz: the lower end of the range.
        maximum_hz: its upper end.
        precision: the relative width to which the bracket is narrowed.
        probe: plays one rate shortly.
        confidence: the confidence of the bracket.
        long_plays: what is played besides short probes.
    """

    minimum_hz: float
    maximum_hz: float
    precision: float
    probe: ProbeFunction
    _: KW_ONLY
    confidence: float = CONFIDENCE
    long_plays: LongPlays = SHORT_PROBES
    _probes: list[Probe] = field(default_factory=list)
    _lower: Probe | None = None
    _fails_hz: float | None = None
    _fails_by_player: bool = False
    _open: list[float] = field(default_factory=list)
    _guess_hz: float = 0.0
    _guess_tried: bool = False
    _stride: float = 1.0
    _done: bool = False
    _proof: Proof = ""
    _candidate_hz: float | None = None
    _has_time: bool = True
    _others: list[CompletionTimes] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._overload = Overload(
            play=self._play_overload,
            max_hz=self.maximum_hz,
            precision=self.precision,
            confidence=self.confidence,
            long_plays=self.long_plays,
            goes_on=self._goes_on,
        )

    @property
    def _holds_hz(self) -> float | None:
        return self._lower.rate_hz if self._lower is not None else None

    def run(self) -> SearchRecord:
        """Run the search; both ends of the range are probed, so that neither is assumed."""
        if self._try(self.minimum_hz) is not False and self.maximum_hz > self.minimum_hz:
            self._try(self.maximum_hz)
        if not self._aim() or self.long_plays.needs_probes(self.precision):
            while (rate_hz := self._next_rate()) is not None and self._goes_on():
                self._try(rate_hz)
        self._prove()
        self._try_upper_end()
        self._try_lower_end_again()
        self._done = True
        return self.record()

    def _goes_on(self) -> bool:
        """Return whether there is time for more than a bracket needs; it does not come back."""
        spent_s = sum(probe.played_s for probe in self._probes)
        self._has_time = (
            self._has_time and spent_s < self.long_plays.search_s and self.long_plays.allows()
        )
        return self._has_time

    def record(self) -> SearchRecord:
        """Return the result so far."""
        unsteady = find_nonstationarity(self._overload.comparable, self._others, self.precision)
        lower, fails_hz = self._lower, self._fails_hz
        limited_by: Limit = "player" if self._fails_by_player else "graph"
        if not self._done:
            limited_by = "interrupted"
        elif fails_hz is None:
            limited_by = "range"
        elif limited_by == "graph":
            fails_hz = unexplained_end(self._probes, self._holds_hz or 0.0, fails_hz)
            limited_by = "graph" if fails_hz == self._fails_hz else "interference"
        return SearchRecord(
            probes=tuple(self._probes),
            holds_hz=self._holds_hz,
            fails_hz=fails_hz,
            limited_by=limited_by,
            precision=self.precision,
            confidence=self.confidence,
            proof=self._proof,
            proof_s=lower.played_s if lower is not None and self._proof else 0.0,
            lost_at_most=lower.lost_at_most if lower is not None else None,
            max_lost=self.long_plays.loss + self.precision / 2,
            capacity=self._overload.record(),
            unsteady=tuple(part.text for part in unsteady),
            watched_s=sum(play.played_s for play in [*self._overload.shown, *self._others]),
            unsteady_ratio=max((part.ratio for part in unsteady), default=1.0),
        )

    def _aim(self) -> bool:
        """Bound the peak by the capacity of the overloaded graph.

        Returns:
            Whether the bracket has an upper end by this, and a lower one to be proven.
        """
        if self._fails_hz is None or self._fails_by_player or self._guess_hz <= 0:
            return False
        if self._fails_hz <= self.minimum_hz:
            return False
        self._overload.run(self._guess_hz)
        upper_hz, lower_hz = self._overload.upper_hz, self._overload.lower_hz
        if upper_hz is None or lower_hz is None or lower_hz <= self.minimum_hz:
            return False
        self._fails_hz = min(upper_hz, self._fails_hz)
        if self.long_plays.confirm is None or self.long_plays.needs_probes(self.precision):
            return self._try(lower_hz) is True
        self._candidate_hz = lower_hz
        return True

    def _play_overload(self, rate_hz: float) -> CompletionTimes | None:
        if self.long_plays.overload is None:
            return None
        outcome = self.long_plays.overload(rate_hz)
        self._probes.append(outcome.probe)
        if outcome.limited_by_player or outcome.probe.explained:
            # Others took a part of the time: what came out is no bound of the capacity.
            return None
        return outcome.departures

    def _prove(self) -> None:
        """Play the lower end whole, and lower ones if that refutes it."""
        rate_hz = self._candidate_hz or self._clearly_held_hz
        if rate_hz is None:
            return
        if self.long_plays.confirm is None:
            self._proof = "probes"
            return
        self._proof = "open"
        undecided: Probe | None = None
        for number in range(_MAX_CONFIRMATIONS):
            if number and not self._goes_on():
                break
            outcome = self.long_plays.confirm(rate_hz, self._overload.proven_hz)
            self._probes.append(outcome.probe)
            self._watch(outcome)
            if outcome.probe.holds:
                self._lower, self._proof = outcome.probe, "confirmed"
                return
            if outcome.probe.holds is None:
                undecided = undecided or outcome.probe
            else:
                self._refute(outcome)
            if rate_hz <= self.minimum_hz:
                break
            rate_hz = max(self._below(outcome), self.minimum_hz)
        self._lower = undecided if undecided is not None else self._highest_kept()

    @property
    def _clearly_held_hz(self) -> float | None:
        """The lower end by probes, not nearer to the upper one than the precision asks.

        Just above the capacity, no play is long enough to see the backlog grow.
        """
        holds_hz, fails_hz = self._holds_hz, self._fails_hz
        if holds_hz is None or fails_hz is None or self._fails_by_player:
            return holds_hz
        return max(min(holds_hz, fails_hz / (1 + self.precision)), self.minimum_hz)

    def _try_upper_end(self) -> None:
        """Play the upper end, too, where it follows from overloads, and raise it if it is kept up.

        A graph may be slower as soon as it is overloaded at all. The lower end is raised to a rate
        that was sustained only if a higher one was, too: just above the capacity the messages of a
        play may be quick ones by chance.
        """
        kept: list[Probe] = []
        while self._proof == "confirmed" and self.long_plays.upper is not None:
            rate_hz = self._fails_hz
            if rate_hz is None or rate_hz in self._failed_hz:
                return
            outcome = self.long_plays.upper(rate_hz, self._overload.tells_after_s)
            self._probes.append(outcome.probe)
            play = outcome.departures
            if outcome.limited_by_player or outcome.probe.explained or play is None:
                return
            self._watch(outcome)
            if play.saturated:
                self._overload.shown.append(play)
            own = estimate_capacity([play.after(play.played_s / 3)], self.confidence)
            if outcome.probe.holds is False or own is None:
                return
            next_hz = min(failed_hz for failed_hz in self._failed_hz if failed_hz > rate_hz)
            lost = outcome.drop_share > self.long_plays.loss + self.precision / 4
            if own.hz < _KEPT_UP * rate_hz and (lost or not outcome.probe.keeps_up):
                self._fails_hz = min(max(rate_hz, own.upper_hz), next_hz)
                return
            kept.append(outcome.probe)
            if len(kept) > 1 and kept[-2].holds:
                self._lower = kept[-2]
            self._fails_hz = next_hz
            if len(kept) < _MAX_RAISES and self._goes_on():
                self._fails_hz = min(next_hz, rate_hz * (1 + self.precision))

    def _try_lower_end_again(self) -> None:
        """Play the lower end once more: the machine may have become slower since it was proven."""
        if self._proof != "confirmed" or self._lower is None or self.long_plays.upper is None:
            return
        outcome = self.long_plays.upper(self._lower.rate_hz, 0.0)
        self._probes.append(outcome.probe)
        is_refuted = outcome.probe.holds is False and not outcome.probe.explained
        if is_refuted and outcome.departures is not None and not outcome.limited_by_player:
            self._overload.learn(outcome.departures)
            learnt_hz, upper_hz = self._overload.lower_hz, self._overload.upper_hz
            if learnt_hz is not None and upper_hz is not None:
                self._fails_hz = min(upper_hz, self._fails_hz or math.inf)
                self._candidate_hz = max(learnt_hz, self.minimum_hz)
                self._prove()

    @property
    def _failed_hz(self) -> list[float]:
        """The rates that the graph did not sustain."""
        return [probe.rate_hz for probe in self._probes if probe.holds is False]

    def _watch(self, outcome: ProbeOutcome) -> None:
        """Examine a play for stops, unless others took a part of its time."""
        if outcome.departures is not None and outcome.probe.taken <= self.precision:
            self._others.append(outcome.departures)

    def _refute(self, outcome: ProbeOutcome) -> None:
        """Take a rate that was not sustained when it was played whole for the upper end."""
        if outcome.probe.explained and self._fails_hz is not None:
            # Others took a part of the time: the upper end that is known stays.
            return
        self._fails_hz = min(outcome.probe.rate_hz, self._fails_hz or math.inf)
        self._fails_by_player = outcome.limited_by_player
        play = outcome.departures
        if play is None or outcome.limited_by_player or outcome.probe.explained:
            return
        if not play.saturated_later:
            return
        if outcome.drop_share > self.long_plays.loss + self.precision / 2 and not find_start(
            [play], self.precision
        ):
            # It loses messages from the first second on; it was not slower than it seemed.
            return
        self._overload.learn(play)

    def _below(self, outcome: ProbeOutcome) -> float:
        """Return the next rate to be played whole, after one was not confirmed."""
        rate_hz = outcome.probe.rate_hz
        learnt_hz = self._overload.lower_hz
        if outcome.probe.holds is False and learnt_hz is not None and learnt_hz < rate_hz * 0.999:
            return learnt_hz
        if outcome.probe.holds is None:
            width = self._overload.capacity.relative_width if self._overload.capacity else 0.0
            return rate_hz / (1 + max(2 * self.precision, width))
        return math.sqrt(rate_hz * self.minimum_hz)

    def _highest_kept(self) -> Probe | None:
        """Return the highest rate below the upper end that was sustained in a probe."""
        kept = [
            probe
            for probe in self._probes
            if (probe.keeps_up or probe.holds) and probe.rate_hz < (self._fails_hz or math.inf)
        ]
        return max(kept, key=lambda each: each.rate_hz, default=None)

    def _try(self, rate_hz: float) -> bool | None:
        outcome = self.probe(rate_hz)
        self._probes.append(outcome.probe)
        self._watch(outcome)
        if outcome.sustained is False and self._needs_retry(outcome):
            # A short disturbance of the machine looks like a slow graph, but rarely twice.
            outcome = self.probe(rate_hz)
            self._probes.append(outcome.probe)
            self._watch(outcome)
        if outcome.sustained is None:
            self._open.append(rate_hz)
        elif outcome.sustained:
            if self._lower is None or rate_hz > self._lower.rate_hz:
                self._lower = outcome.probe
        elif self._fails_hz is None or rate_hz < self._fails_hz:
            self._fails_hz = rate_hz
            self._fails_by_player = outcome.limited_by_player
            if not outcome.limited_by_player and not self._guess_tried:
                self._guess_hz = outcome.probe.delivered_hz
        return outcome.sustained

    def _needs_retry(self, outcome: ProbeOutcome) -> bool:
        """Return True if the failed rate should pass: the lowest, or below an output rate."""
        rate_hz = outcome.probe.rate_hz
        return not outcome.limited_by_player and (
            rate_hz <= self.minimum_hz or rate_hz < self._guess_hz * (1 - self.precision)
        )

    def _next_rate(self) -> float | None:
        """Return the next rate to try, or None when the bracket is as narrow as it can be made."""
        lower_hz = self._holds_hz or self.minimum_hz
        upper_hz = self._fails_hz or self.maximum_hz
        if upper_hz / lower_hz <= 1 + self.precision:
            return None
        if around := sorted(rate for rate in self._open if lower_hz <= rate <= upper_hz):
            # The ends move towards what is undecided, which stays between them.
            gaps = (lower_hz, around[0]), (around[-1], upper_hz)
            wide = (gap for gap in gaps if gap[1] / gap[0] > 1 + self.precision)
            gap = next(wide, None) if len(self._open) < _MAX_OPEN_PROBES else None
            return math.sqrt(gap[0] * gap[1]) if gap is not None else None
        if self._holds_hz is None or self._fails_hz is None:
            return None
        return self._between(self._holds_hz, self._fails_hz)

    def _between(self, holds_hz: float, fails_hz: float) -> float:
        """Return a rate between a sustained and a failed one."""
        guess_hz = self._guess_hz * (1 - self.precision / 2)
        if holds_hz < guess_hz < fails_hz and not self._guess_tried:
            self._guess_tried = True
            return guess_hz
        # Move away from the guess in growing strides until they bracket the peak, then bisect.
        step = 1 + self._stride * 0.999 * self.precision
        self._stride *= _STRIDE_GROWTH
        middle_hz = math.sqrt(holds_hz * fails_hz)
        if holds_hz >= guess_hz:
            return min(middle_hz, holds_hz * step)
        return max(middle_hz, fails_hz / step)


def unexplained_end(probes: Sequence[Probe], lower_hz: float, fails_hz: float) -> float | None:
    """Return the upper end of a bracket that interference cannot explain.

    Args:
        probes: the probes of the search.
        lower_hz: the lower end; 0 if there is none.
        fails_hz: the upper end as it was found.

    Returns:
        The lowest rate above the lower end that the graph did not sustain without such an
        explanation; None if there is none. An upper end at which no probe was played is a bound of
        the capacity, of which no disturbed play is a part: that stays.
    """
    if not any(math.isclose(probe.rate_hz, fails_hz) for probe in probes):
        return fails_hz
    if not any(probe.disturbed for probe in probes):
        return fails_hz
    clean_hz = [
        probe.rate_hz
        for probe in probes
        if probe.holds is False
        and not probe.explained
        and not probe.by_player
        and probe.rate_hz > lower_hz
    ]
    if any(math.isclose(rate_hz, fails_hz) for rate_hz in clean_hz):
        return fails_hz
    return min(clean_hz, default=None)
