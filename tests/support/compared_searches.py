"""Other ways to search for the peak, on the same simulated graphs, for a table.

MLRsearch (draft-ietf-bmwg-mlrsearch) is the library of its authors, which is no dependency of
r2bspec: `pip install MLRsearch`. A message that has not arrived half a second after the last input
counts as lost. Probabilistic bisection (Horstein 1963; Waeber, Frazier, Henderson 2013) plays the
median of its belief for 3 s, asks whether the latency climbs by more than a quarter of the
precision, and takes the answer to be right in 70 % of cases.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from simulated_speeds import PRECISION, WORLDS, Graph

_WAIT_S = 0.5
_REST_S = 0.3
_PROBE_S = 3.0
_RIGHT = 0.7
_MOST_QUESTIONS = 100
_GRID = 4000


@dataclass
class Clock:
    """A graph, and how long was played on it."""

    graph: Graph
    played_s: float = 0.0
    now_s: float = 0.0

    def play(self, rate_hz: float, seconds: float) -> tuple[np.ndarray, np.ndarray, int]:
        """When the answered inputs were published and their outputs left; how many were played."""
        steps = max(2, round(rate_hz * seconds))
        sent_s = np.arange(steps) / rate_hz
        kept, left_s = self.graph.answers(sent_s)
        self.played_s += seconds
        self.now_s += max(seconds, float(left_s.max(initial=0.0))) + _REST_S
        return sent_s[kept], left_s, steps


@dataclass(frozen=True)
class Bracket:
    """What a search found: bounds, and how long it played."""

    lower_hz: float
    upper_hz: float
    played_s: float
    truth_hz: float

    @property
    def contains(self) -> bool:
        """Whether the truth is in the bracket, counted strictly."""
        return self.lower_hz <= self.truth_hz < self.upper_hz

    @property
    def width(self) -> float:
        """The relative width."""
        return self.upper_hz / self.lower_hz - 1 if self.lower_hz else math.inf


Method = Callable[[str, int], Bracket]


def clock_of(name: str, seed: int, about_hz: float = 100.0) -> Clock:
    """The graph of `simulated_speeds.find`, and its clock."""
    random = np.random.default_rng([seed, *name.encode()])
    capacity_hz = about_hz * float(np.exp(random.uniform(-0.1, 0.1)))
    clock = Clock(Graph(WORLDS[name], capacity_hz, random))
    clock.graph.clock_s = lambda: clock.now_s
    return clock


def rfc_2544(name: str, seed: int) -> Bracket:
    """MLRsearch with the goal of RFC 2544: no loss in trials of 60 s."""
    return _mlrsearch(name, seed, final_s=60.0, sum_s=60.0, loss=0.0, exceeds=0.0)


def csit(name: str, seed: int) -> Bracket:
    """MLRsearch with the goal of CSIT: 0.5 % lost, half of 21 trials of 1 s may exceed it."""
    return _mlrsearch(name, seed, final_s=1.0, sum_s=21.0, loss=0.005, exceeds=0.5)


def _mlrsearch(
    name: str, seed: int, *, final_s: float, sum_s: float, loss: float, exceeds: float
) -> Bracket:
    library: Any = importlib.import_module("MLRsearch")
    clock = clock_of(name, seed)

    class Measurer(library.AbstractMeasurer):  # type: ignore[misc]
        def measure(self, intended_duration: float, intended_load: float) -> Any:
            _, left_s, steps = clock.play(intended_load, intended_duration)
            answered = int(np.count_nonzero(left_s <= intended_duration + _WAIT_S))
            return library.MeasurementResult(
                intended_duration=intended_duration,
                intended_load=intended_load,
                offered_count=steps,
                forwarding_count=answered,
            )

    config = library.Config()
    config.goals = (
        library.SearchGoal(
            loss_ratio=loss,
            exceed_ratio=exceeds,
            relative_width=PRECISION,
            initial_trial_duration=1.0,
            final_trial_duration=final_s,
            duration_sum=sum_s,
            fail_fast=False,
        ),
    )
    config.min_load, config.max_load = 10.0, 500.0
    config.search_duration_max = 100_000.0
    config.warmup_duration = 0.0
    (found,) = library.MultipleLossRatioSearch(config).search(Measurer(), lambda _: None).values()
    lower = found.relevant_lower_bound
    upper = found.relevant_upper_bound
    return Bracket(
        float(lower) if lower is not None else 0.0,
        float(upper) if upper is not None else math.inf,
        clock.played_s,
        clock.graph.truth_hz,
    )


def probabilistic_bisection(name: str, seed: int) -> Bracket:
    """Bisect a belief until its central 95 % are as narrow as the precision."""
    clock = clock_of(name, seed)
    logs = np.linspace(math.log(10.0), math.log(500.0), _GRID)
    belief = np.full(_GRID, 1.0 / _GRID)
    low, high = logs[0], logs[-1]
    for number in range(_MOST_QUESTIONS):
        total = np.cumsum(belief)
        low, high = (logs[np.searchsorted(total, each)] for each in (0.025, 0.975))
        if math.expm1(high - low) <= PRECISION:
            break
        middle = int(np.searchsorted(total, 0.5))
        sent_s, left_s, _ = clock.play(math.exp(logs[middle]), _PROBE_S)
        climbs = sent_s.size < 3 or float(np.polyfit(sent_s, left_s - sent_s, 1)[0]) > PRECISION / 4
        # The cell of the median counts for either side in turn: it would keep all the mass.
        below = np.arange(_GRID) < middle + number % 2
        belief = belief * np.where(below == climbs, _RIGHT, 1 - _RIGHT)
        belief /= belief.sum()
    return Bracket(math.exp(low), math.exp(high), clock.played_s, clock.graph.truth_hz)
