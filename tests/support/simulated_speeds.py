"""Graphs whose speed changes by the clock or since the last pause, with a known capacity.

A message needs work; a graph does work at its speed, 1 unless it changes. In the time of the work
done, `W(t)`, such a graph is a server of constant speed, so that departures have a closed form
(Lindley) for any course of the speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.pipeline import judge
from r2bspec.judge.rate_decision import Criterion
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.record.run_record import SearchRecord
from run_simulation import Simulation, objective
from simulated_queues import Searching, Times, departures

_HORIZON_S = 3000.0
PRECISION = 0.02

Result = Literal["right", "wrong", "rarer", "open", "unsteady", "not shown"]


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


def _throttled(factor: float, after_s: float) -> Callable[[np.random.Generator], Speed]:
    lengths_s, speeds = np.array([after_s, _HORIZON_S]), np.array([1.0, factor])
    return lambda _: _speed(lengths_s, speeds, factor)


@dataclass(frozen=True)
class World:
    """A kind of graph.

    Attributes:
        speed: how its speed changes by the clock.
        variation: the coefficient of variation of its service times.
        exponential: whether these are exponential.
        loses: the share of messages that it loses.
        falls: how much longer a message takes at twice the capacity, as a share; evenly with what
            is offered beyond the capacity.
        step: how much longer a message takes as soon as more than the capacity is offered.
        collects: a stop of so many seconds after so many messages.
        every_s: how often comes, on average, what lowers its speed.
    """

    speed: Callable[[np.random.Generator], Speed] = _steady
    variation: float = 0.0
    exponential: bool = False
    loses: float = 0.0
    falls: float = 0.0
    step: tuple[float, float] = (0.0, 1.0)
    collects: tuple[float, int] = (0.0, 0)
    every_s: float = 0.0


_USUAL: Final[dict[str, World]] = {
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

FALLING: Final[dict[str, World]] = {
    **{
        f"falls by {falls:g}, cv {cv:g}": World(falls=falls, variation=cv)
        for falls in (0.0, 0.03, 0.05, 0.1, 0.2, 0.5)
        for cv in (0.1, 0.3, 1.0)
    },
    **{
        f"100 to 97 Hz at {at:g} of the capacity, cv 0.3": World(step=(0.031, at), variation=0.3)
        for at in (1.0, 1.05, 1.2)
    },
}
RARE: Final[dict[str, World]] = {
    **{
        f"stops for {stop_s:g} s every {every_s:g} s{words}": World(
            stops(stop_s, every_s), variation=0.1, every_s=every_s
        )
        for stops, words in ((_periodic, ""), (_random_stops, ", at random"))
        for stop_s, every_s in (
            (0.1, 4.0),
            (0.3, 10.0),
            (0.5, 20.0),
            (1.0, 30.0),
            (2.0, 60.0),
            (3.0, 40.0),
            (5.0, 100.0),
            (10.0, 300.0),
        )
    },
    "stops for 1 s each 5,000 messages": World(collects=(1.0, 5000), variation=0.1, every_s=51.0),
    **{
        f"0.85 of its speed after {after_s:g} s": World(
            _throttled(0.85, after_s), variation=0.1, every_s=math.inf
        )
        for after_s in (20.0, 60.0, 120.0)
    },
}
SLOWING: Final[dict[str, World]] = {
    f"0.97 of its speed after {after_s:g} s": World(_throttled(0.97, after_s), variation=0.1)
    for after_s in (45.0, 60.0)
}
WORLDS: Final = _USUAL | FALLING | RARE | SLOWING


@dataclass
class Graph:
    """One graph of a world; its clock is that of what is played on it."""

    world: World
    capacity_hz: float
    random: np.random.Generator
    clock_s: Callable[[], float] = field(default=lambda: 0.0)

    def __post_init__(self) -> None:
        self.speed = self.world.speed(self.random)
        self.collected = int(self.random.integers(max(self.world.collects[1], 1)))

    @property
    def truth_hz(self) -> float:
        """What it sustains in the long run; 0 where it loses messages at any rate."""
        if self.world.loses:
            return 0.0
        stop_s, messages = self.world.collects
        stopped_s = stop_s / messages if messages else 0.0
        return self.speed.mean / (1 / self.capacity_hz + stopped_s)

    def answers(self, arrivals_s: Times) -> tuple[NDArray[np.int64], Times]:
        """See `simulated_queues.Server.answers`."""
        begun_s = 0.0 if self.speed.restarts else self.clock_s()
        times_s, work_s = self.speed.times_s, self.speed.work_s
        done = departures(
            np.interp(begun_s + arrivals_s, times_s, work_s), self._services(arrivals_s)
        )
        left_s = np.interp(done, work_s, times_s) - begun_s
        kept = np.flatnonzero(self.random.random(arrivals_s.size) >= self.world.loses)
        return kept, left_s[kept]

    def _services(self, arrivals_s: Times) -> Times:
        number = arrivals_s.size
        offered = (number - 1) / (arrivals_s[-1] - arrivals_s[0]) / self.capacity_hz
        slower, beyond = self.world.step
        # What is offered is known to a nanosecond.
        factor = 1 + self.world.falls * max(offered - 1, 0) + slower * (offered > beyond + 1e-9)
        services_s: Times = factor / self.capacity_hz * self._works(number)
        return services_s + self._stops_s(number)

    def _stops_s(self, number: int) -> Times:
        """Seconds by which messages take longer because memory is collected."""
        stop_s, each = self.world.collects
        if not each:
            return np.zeros(number)
        at = (self.collected + np.arange(number)) % each == each - 1
        self.collected += number
        return np.where(at, stop_s, 0.0)

    def _works(self, number: int) -> Times:
        if self.world.exponential:
            return self.random.exponential(1.0, number)
        if not self.world.variation:
            return np.ones(number)
        spread = math.sqrt(math.log1p(self.world.variation**2))
        return self.random.lognormal(-(spread**2) / 2, spread, number)


@dataclass(frozen=True)
class Found:
    """What a search found, and the truth."""

    record: SearchRecord
    truth_hz: float
    played_s: float
    every_s: float = 0.0
    budget_s: float = 0.0

    @property
    def contains(self) -> bool:
        """Whether the bracket holds the truth, counted strictly."""
        lower, upper = self.record.holds_hz or 0.0, self.record.upper_hz or np.inf
        return lower <= self.truth_hz < upper

    @property
    def contains_apart(self) -> bool:
        """Whether what lies between its ends, moved apart by the ratio of speeds, holds it."""
        ratio = self.record.unsteady_ratio
        lower, upper = self.record.holds_hz or 0.0, self.record.upper_hz or np.inf
        return lower / ratio <= self.truth_hz < upper * ratio

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
        if self.contains:
            return "right"
        # The bracket says for what it has its confidence.
        return "rarer" if self.every_s > self.record.recurs_s else "wrong"


def find(name: str, seed: int, *, confirm_s: float = 30.0) -> Found:
    """Search a graph of a world, from a tenth to five times its capacity."""
    random = np.random.default_rng([seed, *name.encode()])
    capacity_hz = 100.0 * float(np.exp(random.uniform(-0.1, 0.1)))
    graph = Graph(WORLDS[name], capacity_hz, random)
    searching = Searching(graph, Criterion(precision=PRECISION), confirm_s=confirm_s)
    graph.clock_s = lambda: searching.clock_s
    record = searching.run(10.0, 500.0)
    return Found(
        record, graph.truth_hz, searching.played_s, graph.world.every_s, searching.budget_s
    )


def required(record: SearchRecord, limit_hz: float) -> RequirementVerdict | None:
    """The verdict on a peak of at least this rate; None if the search has no lower end."""
    if record.holds_hz is None:
        return None
    samples = Simulation(segments=(), search=record).samples()
    wanted = objective(f"peak.rate >= {limit_hz!r} Hz", at="")
    return judge({"one": wanted}, samples).requirements[0]
