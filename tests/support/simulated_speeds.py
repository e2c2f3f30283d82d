"""Graphs whose speed changes by the clock or since the last pause, with a known capacity.

A message needs work; a graph does work at its speed, 1 unless it changes. In the time of the work
done, `W(t)`, such a graph is a server of constant speed, so that departures have a closed form
(Lindley) for any course of the speed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.rate_decision import Criterion
from r2bspec.record.run_record import SearchRecord
from simulated_queues import Searching, Times, departures

_HORIZON_S = 3000.0
PRECISION = 0.02

Result = Literal["right", "wrong", "open", "unsteady", "not shown"]


@dataclass(frozen=True)
class Speed:
    """The work that a graph has done by a time, piecewise linear.

    Attributes:
        times_s: where the speed changes, ascending from 0.
        work_s: the work done by then.
        mean: the speed in the long run.
        restarts: whether the course begins anew with each play.
    """

    times_s: Times
    work_s: Times
    mean: float = 1.0
    restarts: bool = False


def _speed(lengths_s: Times, speeds: Times, mean: float, *, restarts: bool = False) -> Speed:
    # A stopped graph crawls, so that work and time can be converted both ways.
    work_s = np.cumsum(lengths_s * np.maximum(speeds, 1e-9))
    return Speed(
        np.concatenate([[0.0], np.cumsum(lengths_s)]),
        np.concatenate([[0.0], work_s]),
        mean,
        restarts,
    )


def _steady(_: np.random.Generator) -> Speed:
    return _speed(np.array([_HORIZON_S]), np.array([1.0]), 1.0)


def _at_first(factor: float, seconds: float) -> Callable[[np.random.Generator], Speed]:
    """A factor in the first seconds of each play."""
    lengths_s, speeds = np.array([seconds, _HORIZON_S]), np.array([factor, 1.0])
    return lambda _: _speed(lengths_s, speeds, 1.0, restarts=True)


def _thermal(_: np.random.Generator) -> Speed:
    lengths_s = np.full(round(_HORIZON_S / 0.5), 0.5)
    middle_s = np.cumsum(lengths_s) - 0.25
    return _speed(lengths_s, 1 + 0.2 * np.exp(-middle_s / 30.0), 1.0)


def _periodic(stop_s: float, every_s: float) -> Callable[[np.random.Generator], Speed]:
    def speed(random: np.random.Generator) -> Speed:
        number = round(_HORIZON_S / every_s)
        lengths_s = np.tile([every_s - stop_s, stop_s], number)
        lengths_s[0] *= random.random()
        return _speed(lengths_s, np.tile([1.0, 0.0], number), 1 - stop_s / every_s)

    return speed


def _random_stops(stop_s: float, every_s: float) -> Callable[[np.random.Generator], Speed]:
    def speed(random: np.random.Generator) -> Speed:
        number = round(_HORIZON_S / every_s)
        runs_s = random.exponential(every_s - stop_s, number)
        lengths_s = np.stack([runs_s, np.full(number, stop_s)], axis=1).ravel()
        return _speed(lengths_s, np.tile([1.0, 0.0], number), 1 - stop_s / every_s)

    return speed


def _two(low: float, each_s: float) -> Callable[[np.random.Generator], Speed]:
    def speed(random: np.random.Generator) -> Speed:
        number = round(_HORIZON_S / each_s) // 2 * 2
        lengths_s = random.exponential(each_s, number)
        speeds = np.tile([1.0, low], number // 2)
        return _speed(lengths_s, speeds if random.random() < 0.5 else speeds[::-1], (1 + low) / 2)

    return speed


@dataclass(frozen=True)
class World:
    """A kind of graph: how its speed changes, how its messages differ, and what it loses."""

    speed: Callable[[np.random.Generator], Speed] = _steady
    variation: float = 0.0
    exponential: bool = False
    loses: float = 0.0


WORLDS: Final[dict[str, World]] = {
    "equal times": World(),
    "log-normal, cv 0.1": World(variation=0.1),
    "log-normal, cv 0.3": World(variation=0.3),
    "log-normal, cv 0.6": World(variation=0.6),
    "exponential": World(exponential=True),
    "half speed in the first 1 s": World(_at_first(0.5, 1.0)),
    "1.5 x in the first 2 s (turbo)": World(_at_first(1.5, 2.0)),
    "1.2 x in the first 5 s (credits)": World(_at_first(1.2, 5.0)),
    "1.2 x in the first 5 s, cv 0.3": World(_at_first(1.2, 5.0), variation=0.3),
    "1.2 x cold, 30 s (thermal)": World(_thermal),
    "stops for 0.1 s every 1 s": World(_periodic(0.1, 1.0)),
    "stops for 0.2 s every 2 s": World(_periodic(0.2, 2.0)),
    "stops for 0.5 s every 5 s": World(_periodic(0.5, 5.0)),
    "stops for 1 s every 10 s": World(_periodic(1.0, 10.0)),
    "stops for 0.5 s every 5 s, at random": World(_random_stops(0.5, 5.0)),
    "two speeds, 1 and 0.7, 5 s each": World(_two(0.7, 5.0)),
    "two speeds, 1 and 0.7, 1 s each": World(_two(0.7, 1.0)),
    "loses 2 % at random": World(loses=0.02),
    "loses 5 % at random": World(loses=0.05),
}


@dataclass
class Graph:
    """One graph of a world; its clock is that of what is played on it."""

    world: World
    capacity_hz: float
    random: np.random.Generator
    clock_s: Callable[[], float] = field(default=lambda: 0.0)

    def __post_init__(self) -> None:
        self.speed = self.world.speed(self.random)

    @property
    def truth_hz(self) -> float:
        """What it sustains in the long run; 0 where it loses messages at any rate."""
        return 0.0 if self.world.loses else self.capacity_hz * self.speed.mean

    def answers(self, arrivals_s: Times) -> tuple[NDArray[np.int64], Times]:
        """See `simulated_queues.Server.answers`."""
        begun_s = 0.0 if self.speed.restarts else self.clock_s()
        times_s, work_s = self.speed.times_s, self.speed.work_s
        done = departures(
            np.interp(begun_s + arrivals_s, times_s, work_s), self._services(arrivals_s.size)
        )
        left_s = np.interp(done, work_s, times_s) - begun_s
        kept = np.flatnonzero(self.random.random(arrivals_s.size) >= self.world.loses)
        return kept, left_s[kept]

    def _services(self, number: int) -> Times:
        mean_s = 1 / self.capacity_hz
        if self.world.exponential:
            return self.random.exponential(mean_s, number)
        if not self.world.variation:
            return np.full(number, mean_s)
        spread = np.sqrt(np.log1p(self.world.variation**2))
        return self.random.lognormal(np.log(mean_s) - spread**2 / 2, spread, number)


@dataclass(frozen=True)
class Found:
    """What a search found, and the truth."""

    record: SearchRecord
    truth_hz: float
    played_s: float

    @property
    def contains(self) -> bool:
        """Whether the bracket holds the truth, counted strictly."""
        lower, upper = self.record.holds_hz or 0.0, self.record.upper_hz or np.inf
        return lower <= self.truth_hz < upper

    @property
    def width(self) -> float:
        """The relative width of the bracket."""
        lower, upper = self.record.holds_hz or 0.0, self.record.upper_hz or np.inf
        return upper / lower - 1 if lower else np.inf

    @property
    def result(self) -> Result:
        """What the search says, and whether it is true."""
        if self.record.unsteady:
            return "unsteady"
        if self.record.holds_hz is None:
            return "not shown"
        if not self.record.shown:
            return "open"
        return "right" if self.contains else "wrong"


def find(name: str, seed: int, *, about_hz: float = 100.0, confirm_s: float = 30.0) -> Found:
    """Search a graph of a world, from a tenth to five times its capacity."""
    random = np.random.default_rng([seed, *name.encode()])
    capacity_hz = about_hz * float(np.exp(random.uniform(-0.1, 0.1)))
    graph = Graph(WORLDS[name], capacity_hz, random)
    searching = Searching(graph, Criterion(precision=PRECISION), confirm_s=confirm_s)
    graph.clock_s = lambda: searching.clock_s
    record = searching.run(about_hz / 10, about_hz * 5)
    return Found(record, graph.truth_hz, searching.played_s)
