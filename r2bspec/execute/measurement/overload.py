"""Overloading a graph, some seconds at a time, until its capacity is known precisely enough."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from r2bspec.judge.stationarity import (
    Capacity,
    CompletionTimes,
    compare_pace,
    estimate_capacity,
    find_start,
)
from r2bspec.record.run_record import CapacityRecord

_FACTORS = (1.3, 1.1)
"""The offered rates, in turn, as multiples of what comes out: clearly too much, and not much more,
because graphs that are drowned in messages are slower. If the first is slower than the second, only
the second counts."""

_Z = 3.0
"""Standard errors by which it must be slower."""

_MAX_UNSATURATED = 4
"""So many plays may turn out not to overload the graph; each next one offers more."""


@dataclass
class Overload:
    """The overloaded plays of one search, and the capacity that they show.

    Attributes:
        play: plays a rate for the usual length of an overloaded play.
        max_hz: the highest rate of the search.
        precision: the relative width to which the capacity is estimated.
        confidence: of the interval.
        budget_s: overloaded playing ends after so many seconds.
        stages: how many queues there may be in a row.
        loss: the share that may be lost; a graph with bounded queues sustains more because of it.
        plays: those by which the capacity is estimated.
        shown: all that were played, to be examined for steadiness.
    """

    play: Callable[[float], CompletionTimes | None]
    max_hz: float
    precision: float
    confidence: float
    budget_s: float
    stages: int = 1
    loss: float = 0.0
    plays: list[CompletionTimes] = field(default_factory=list)
    shown: list[CompletionTimes] = field(default_factory=list)
    capacity: Capacity | None = None

    @property
    def played_s(self) -> float:
        """The seconds of all overloaded plays."""
        return sum(each.played_s for each in self.plays)

    def run(self, guess_hz: float) -> Capacity | None:
        """Overload the graph until its capacity is known to the precision, or the time is over.

        Args:
            guess_hz: what came out of a first overload, in steps per second.

        Returns:
            None if the graph could not be overloaded, too few outputs came, or the graph is slower
            the more it is overloaded.
        """
        rate_hz, unsaturated = min(guess_hz * _FACTORS[0], self.max_hz), 0
        while self.played_s < self.budget_s:
            found = self.play(rate_hz)
            if found is None:
                return None
            if not found.saturated:
                if self.capacity is not None and rate_hz > self.capacity.upper_hz:
                    # With less overload it is faster than with more: that bounds nothing.
                    self.plays, self.capacity = [], None
                    return None
                unsaturated += 1
                if unsaturated >= _MAX_UNSATURATED or rate_hz >= self.max_hz:
                    return None
                rate_hz = min(rate_hz * _FACTORS[0], self.max_hz)
                continue
            self.add(found)
            self._leave_out_drowned()
            if self.capacity is not None:
                if self.factors_compared and self.capacity.relative_width <= self.precision:
                    break
                factor = _FACTORS[len(self.plays) % len(_FACTORS)]
                rate_hz = min(self.capacity.hz * factor, self.max_hz)
        return self.capacity

    @property
    def factors_compared(self) -> bool:
        """Whether the graph was overloaded by more and by less."""
        offered = [each.offered_hz for each in self.plays]
        return bool(offered) and max(offered) > 1.1 * min(offered)

    def _leave_out_drowned(self) -> None:
        """Leave out the plays with more overload if the graph was clearly slower in them."""
        if not self.factors_compared:
            return
        middle_hz = math.sqrt(
            max(each.offered_hz for each in self.plays)
            * min(each.offered_hz for each in self.plays)
        )
        gentle = [each for each in self.plays if each.offered_hz < middle_hz]
        drowned = [each for each in self.plays if each.offered_hz >= middle_hz]
        slower, error = compare_pace(drowned, gentle)
        if slower > max(self.precision / 2, _Z * error):
            self.plays = gentle
            self.capacity = estimate_capacity(gentle, self.confidence, stages=self.stages)

    def add(self, play: CompletionTimes, *, shown: bool = True) -> None:
        """Count a play in which the graph was overloaded."""
        self.plays.append(play)
        if shown:
            self.shown.append(play)
        self.capacity = estimate_capacity(self.plays, self.confidence, stages=self.stages)

    def learn(self, play: CompletionTimes) -> None:
        """Learn from a play that was to confirm a rate, and refuted it.

        Its later half shows the graph when it no longer keeps up. If it is a faster start that the
        earlier plays have measured, only this half counts from now on.
        """
        self.shown.append(play)
        later = play.after(play.played_s / 2)
        started = find_start(self.shown, self.precision)
        if started is not None:
            self.plays = []
        self.add(later, shown=False)

    def record(self) -> CapacityRecord | None:
        """The capacity as the run record has it."""
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
        upper_hz = max(self.capacity.upper_hz, self.capacity.hz * (1 + self.precision / 2))
        return upper_hz / (1 - self.loss) if self.loss < 1 else None

    @property
    def lower_hz(self) -> float | None:
        """Where the lower end of the bracket should be, to be proven."""
        if self.capacity is None:
            return None
        upper_hz = max(self.capacity.upper_hz, self.capacity.hz * (1 + self.precision / 2))
        return min(self.capacity.lower_hz, upper_hz / (1 + self.precision))
