"""The peak search: the highest offered rate that is sustained, to a given relative precision.

The search is independent of processes: it calls a probe and evaluates its outcome. It narrows the
bracket quickly, because the output rate of an overloaded graph is close to the rate that it can
sustain; the first candidates are just below and just above it. The bracket is then bisected, by the
ratio of its ends, until it is as narrow as the precision.

A probe may be undecided, if the times of the graph vary too much for its length. The search then
moves away from this rate, down and up, by the resolution of the probe, and by twice as much if that
probe is undecided, too. The final bracket is then wider than the precision, which the record shows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from r2bspec.language.confidence import CONFIDENCE
from r2bspec.record.run_record import Probe, SearchRecord

_STRIDE_GROWTH = 4.0
"""Strides of 1, 4 and 16 times the precision: after a good guess the first one ends the search; a
bad guess is corrected after two or three."""

_MAX_STEP = 0.5
"""The maximum relative distance of the next probe from an undecided one."""

_MAX_OPEN_PROBES = 8
"""Undecided probes are the longest ones; after this number the search ends."""


@dataclass(frozen=True)
class ProbeOutcome:
    """The result of one probe.

    Attributes:
        probe: for the record.
        limited_by_player: the rate was not sustained because the player could not offer it, which
            is no property of the graph.
        relative_half_width: of the interval in which the rate of the graph lies.
    """

    probe: Probe
    limited_by_player: bool = False
    relative_half_width: float = 0.0


ProbeFunction = Callable[[float], ProbeOutcome]


class PeakSearch:
    """One search; `run` executes it, `record` is its current state."""

    def __init__(
        self,
        minimum_hz: float,
        maximum_hz: float,
        precision: float,
        probe: ProbeFunction,
        *,
        confidence: float = CONFIDENCE,
    ) -> None:
        self._minimum_hz = minimum_hz
        self._maximum_hz = maximum_hz
        self._precision = precision
        self._confidence = confidence
        self._probe = probe
        self._probes: list[Probe] = []
        self._holds_hz: float | None = None
        self._fails_hz: float | None = None
        self._fails_by_player = False
        self._open: dict[float, float] = {}
        self._guess_hz = 0.0
        self._guess_tried = False
        self._stride = 1.0
        self._done = False

    def run(self) -> SearchRecord:
        """Search. Both ends of the range are also probed, so that neither is assumed."""
        if self._try(self._minimum_hz) is not False and self._maximum_hz > self._minimum_hz:
            self._try(self._maximum_hz)
        while (rate_hz := self._next_rate()) is not None:
            self._try(rate_hz)
        self._done = True
        return self.record()

    def record(self) -> SearchRecord:
        """The result so far."""
        return SearchRecord(
            probes=tuple(self._probes),
            holds_hz=self._holds_hz,
            fails_hz=self._fails_hz,
            limited_by=self._limited_by(),
            precision=self._precision,
            confidence=self._confidence,
        )

    def _limited_by(self) -> Literal["graph", "player", "range", "interrupted"]:
        if not self._done:
            return "interrupted"
        if self._fails_hz is None:
            return "range"
        return "player" if self._fails_by_player else "graph"

    def _try(self, rate_hz: float) -> bool | None:
        outcome = self._probe(rate_hz)
        self._probes.append(outcome.probe)
        if outcome.probe.holds is False and self._needs_retry(outcome):
            # A short disturbance of the machine looks like a slow graph, but rarely twice.
            outcome = self._probe(rate_hz)
            self._probes.append(outcome.probe)
        if outcome.probe.holds is None:
            self._open[rate_hz] = outcome.relative_half_width
        elif outcome.probe.holds:
            self._holds_hz = max(rate_hz, self._holds_hz or 0.0)
        elif self._fails_hz is None or rate_hz < self._fails_hz:
            self._fails_hz = rate_hz
            self._fails_by_player = outcome.limited_by_player
            if not outcome.limited_by_player and not self._guess_tried:
                self._guess_hz = outcome.probe.delivered_hz
        return outcome.probe.holds

    def _needs_retry(self, outcome: ProbeOutcome) -> bool:
        """Whether the failed rate was expected to pass: the lowest, or below an output rate."""
        rate_hz = outcome.probe.rate_hz
        return not outcome.limited_by_player and (
            rate_hz <= self._minimum_hz or rate_hz < self._guess_hz * (1 - self._precision)
        )

    def _next_rate(self) -> float | None:
        """The next rate to try, or None when the bracket is as narrow as it can be made."""
        lower_hz = self._holds_hz or self._minimum_hz
        upper_hz = self._fails_hz or self._maximum_hz
        if upper_hz / lower_hz <= 1 + self._precision:
            return None
        around = sorted(rate for rate in self._open if lower_hz <= rate <= upper_hz)
        if around:
            return self._next_to_open(around, lower_hz, upper_hz)
        if self._holds_hz is None or self._fails_hz is None:
            return None
        return self._between(self._holds_hz, self._fails_hz)

    def _between(self, holds_hz: float, fails_hz: float) -> float:
        """A rate between a sustained and a failed one."""
        guess_hz = self._guess_hz * (1 - self._precision / 2)
        if holds_hz < guess_hz < fails_hz and not self._guess_tried:
            self._guess_tried = True
            return guess_hz
        # Move away from the guess in growing strides until they bracket the peak, then bisect.
        step = 1 + self._stride * 0.999 * self._precision
        self._stride *= _STRIDE_GROWTH
        middle_hz = math.sqrt(holds_hz * fails_hz)
        if holds_hz >= guess_hz:
            return min(middle_hz, holds_hz * step)
        return max(middle_hz, fails_hz / step)

    def _next_to_open(self, around: list[float], lower_hz: float, upper_hz: float) -> float | None:
        """A rate below or above the undecided ones; None if both gaps are as narrow as possible.

        Args:
            around: the undecided rates of the bracket, ascending.
            lower_hz: the lower end of the bracket.
            upper_hz: its upper end.
        """
        if len(self._open) >= _MAX_OPEN_PROBES:
            return None
        below_hz, above_hz = around[0], around[-1]
        down, up = (
            1 + min(max(self._precision, self._open[each]), _MAX_STEP) * 2.0 ** (len(around) // 2)
            for each in (below_hz, above_hz)
        )
        # A gap of one step is as narrow as possible.
        if below_hz / lower_hz > down * 1.001:
            return below_hz / down
        if upper_hz / above_hz > up * 1.001:
            return above_hz * up
        return None
