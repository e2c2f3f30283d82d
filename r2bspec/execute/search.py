"""The search for the peak: the highest offered rate that holds, to a stated relative precision.

The search knows nothing of processes: it calls a probe and reads its outcome. It brackets fast,
because an overloaded graph betrays its own rate: what comes out of it at too high an offer is
close to what it can sustain, so the first candidates lie just below and just above that. From
there the bracket is halved in the ratio of its ends until it is as narrow as the precision.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from r2bspec.record.model import Probe, SearchRecord

_STRIDE_GROWTH = 4.0
"""Strides of 1, 4 and 16 times the precision: next to a good guess the first one ends the search,
and a bad guess is left behind after two or three."""


@dataclass(frozen=True)
class Outcome:
    """What one probe found.

    `by_player` is True where the rate did not hold because the player could not offer it, which
    says nothing about the graph.
    """

    probe: Probe
    by_player: bool = False


ProbeFunction = Callable[[float], Outcome]


class PeakSearch:
    """One search; `run` carries it out, `record` is what is known at any time."""

    def __init__(
        self, minimum_hz: float, maximum_hz: float, precision: float, probe: ProbeFunction
    ) -> None:
        self._minimum_hz = minimum_hz
        self._maximum_hz = maximum_hz
        self._precision = precision
        self._probe = probe
        self._probes: list[Probe] = []
        self._holds_hz: float | None = None
        self._fails_hz: float | None = None
        self._fails_by_player = False
        self._guess_hz = 0.0
        self._guess_tried = False
        self._stride = 1.0
        self._done = False

    def run(self) -> SearchRecord:
        """Search. Both ends of the range are probed, so that neither is taken for granted."""
        if not self._try(self._minimum_hz):
            return self._finish()
        if self._try(self._maximum_hz):
            return self._finish()
        while (rate_hz := self._next_rate()) is not None:
            self._try(rate_hz)
        return self._finish()

    def record(self) -> SearchRecord:
        """What has been found so far."""
        return SearchRecord(
            probes=tuple(self._probes),
            holds_hz=self._holds_hz,
            fails_hz=self._fails_hz,
            limited_by=self._limited_by(),
        )

    def _finish(self) -> SearchRecord:
        self._done = True
        return self.record()

    def _limited_by(self) -> Literal["graph", "player", "range", "interrupted"]:
        if not self._done:
            return "interrupted"
        if self._fails_hz is None:
            return "range"
        return "player" if self._fails_by_player else "graph"

    def _try(self, rate_hz: float) -> bool:
        outcome = self._probe(rate_hz)
        self._probes.append(outcome.probe)
        if not outcome.probe.holds and self._surprising(outcome):
            # A hiccup of the machine looks like a slow graph once, but hardly twice.
            outcome = self._probe(rate_hz)
            self._probes.append(outcome.probe)
        if outcome.probe.holds:
            self._holds_hz = max(rate_hz, self._holds_hz or 0.0)
        elif self._fails_hz is None or rate_hz < self._fails_hz:
            self._fails_hz = rate_hz
            self._fails_by_player = outcome.by_player
            if not outcome.by_player and not self._guess_tried:
                self._guess_hz = outcome.probe.delivered_hz
        return outcome.probe.holds

    def _surprising(self, outcome: Outcome) -> bool:
        """Whether a rate failed that should have held: the lowest, or one seen to be delivered."""
        rate_hz = outcome.probe.rate_hz
        return not outcome.by_player and (
            rate_hz <= self._minimum_hz or rate_hz < self._guess_hz * (1 - self._precision)
        )

    def _next_rate(self) -> float | None:
        """The next rate to try, or None when the bracket is narrow enough."""
        assert self._holds_hz is not None  # noqa: S101 - the minimum held
        assert self._fails_hz is not None  # noqa: S101 - the maximum did not
        if self._fails_hz / self._holds_hz <= 1 + self._precision:
            return None
        guess_hz = self._guess_hz * (1 - self._precision / 2)
        if self._holds_hz < guess_hz < self._fails_hz and not self._guess_tried:
            self._guess_tried = True
            return guess_hz
        # Walk away from the guess in growing strides until the peak lies between, then halve.
        step = 1 + self._stride * 0.999 * self._precision
        self._stride *= _STRIDE_GROWTH
        middle_hz = math.sqrt(self._holds_hz * self._fails_hz)
        if self._holds_hz >= guess_hz:
            return min(middle_hz, self._holds_hz * step)
        return max(middle_hz, self._fails_hz / step)
