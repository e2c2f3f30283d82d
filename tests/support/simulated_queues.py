"""Servers with queues, one or several in a row, simulated: what player and monitor would record."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from r2bspec.execute.measurement.peak_search import LongPlays, PeakSearch, ProbeOutcome
from r2bspec.judge.measure.delivery import DeliveryEstimate
from r2bspec.judge.measure.matching import match
from r2bspec.judge.rate_decision import (
    Criterion,
    InterimLook,
    ProbeJudgement,
    estimate_probe,
    judge_final,
    judge_interim,
    plan_interim_looks,
)
from r2bspec.judge.stationarity import CompletionTimes
from r2bspec.language.benchmark_defaults import (
    MAX_LONGER,
    MIN_PROBE_STEPS,
    OVERLOAD_PROBES,
    SEARCH_CONFIRMATIONS,
    SEARCH_PROBES,
)
from r2bspec.record.run_record import Probe, SearchRecord
from r2bspec.record.sample_arrays import MONITOR_DTYPE, PLAYBACK_DTYPE, Rows

BEGIN_NS = 7_000_000_000_000_000
_STAMP_NS = 1_800_000_000_000_000_000

DEEP = 1_000_000
SHALLOW = 10

Times = NDArray[np.float64]


@dataclass(frozen=True)
class Server:
    """Servers in a row, each with a queue before it.

    Attributes:
        capacity_hz: messages that each serves per second, on average.
        depth: messages that may wait; the oldest one makes room for a new one, as in ROS.
        spread: 0 for equal service times, 1 for exponential ones.
        stages: how many servers there are.
        loses: of the messages that come, the share that is lost at once.
        stalls: (from, to) in seconds: nothing is begun in this time.
        drowns: how much slower it is at twice its capacity, as a share; evenly with the rate.
    """

    capacity_hz: float
    depth: int = DEEP
    spread: float = 0.0
    stages: int = 1
    loses: float = 0.0
    stalls: tuple[float, float] = (0.0, 0.0)
    drowns: float = 0.0
    seed: int = 0
    random: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "random", np.random.default_rng(self.seed))

    def answers(self, arrivals_s: Times) -> tuple[NDArray[np.int64], Times]:
        """The numbers of the messages that are not lost, and when each leaves, in seconds."""
        numbers = np.flatnonzero(self.random.random(arrivals_s.size) >= self.loses)
        times_s = arrivals_s[numbers]
        for _ in range(self.stages):
            offered = (arrivals_s.size - 1) / (arrivals_s[-1] - arrivals_s[0]) / self.capacity_hz
            mean_s = (1.0 + self.drowns * max(offered - 1.0, 0.0)) / self.capacity_hz
            serve_s = mean_s * (
                (1.0 - self.spread) + self.spread * self.random.exponential(size=times_s.size)
            )
            if self.depth >= DEEP and self.stalls == (0.0, 0.0):
                times_s = departures(times_s, serve_s)
            else:
                kept, times_s = self._serve(times_s, serve_s)
                numbers = numbers[kept]
        return numbers, times_s

    def _serve(self, arrive_s: Times, serve_s: Times) -> tuple[NDArray[np.int64], Times]:
        waiting: deque[int] = deque()
        served: list[int] = []
        left_s: list[float] = []
        free_s = 0.0

        def serve(until_s: float) -> None:
            nonlocal free_s
            while waiting:
                begin_s = max(free_s, arrive[waiting[0]])
                if self.stalls[0] <= begin_s < self.stalls[1]:
                    begin_s = self.stalls[1]
                if begin_s > until_s:
                    return
                number = waiting.popleft()
                free_s = begin_s + float(serve_s[number])
                served.append(number)
                left_s.append(free_s)

        arrive = arrive_s.tolist()
        for number, arrival_s in enumerate(arrive):
            serve(arrival_s)
            waiting.append(number)
            if len(waiting) > self.depth:
                waiting.popleft()
        serve(np.inf)
        return np.array(served, dtype=np.int64), np.array(left_s)


def departures(arrive_s: Times, serve_s: Times) -> Times:
    """Lindley: d_i = max(a_i, d_(i-1)) + s_i, in closed form with running sums and maxima."""
    served = np.cumsum(serve_s)
    return served + np.maximum.accumulate(arrive_s - (served - serve_s))


@dataclass(frozen=True)
class Probed:
    """How a probe ended: what was judged, after how long, and from what."""

    judgement: ProbeJudgement
    delivery: DeliveryEstimate
    stopped_s: float
    playback: Rows
    monitor: Rows
    departures: CompletionTimes


class Answering(Protocol):
    """What can be probed: a graph that answers inputs."""

    def answers(self, arrivals_s: Times) -> tuple[NDArray[np.int64], Times]:
        """See `Server.answers`."""
        ...


@dataclass(frozen=True)
class Play:
    """How a rate is played; see `r2bspec.execute.measurement.rate_probe`."""

    purpose: Literal["probe", "saturation", "confirmation"] = "probe"
    ends_on: frozenset[bool] = frozenset({True, False})
    whole: bool = False
    enough: bool = False
    proven_hz: float = 0.0


SUSTAINED = Play(ends_on=frozenset({False}), whole=True, enough=True)
"""Of a rate that an objective requires to be sustained."""


def probe(
    server: Answering,
    rate_hz: float,
    *,
    criterion: Criterion | None = None,
    seconds: float = 10.0,
    player_hz: float | None = None,
    arrivals_s: Times | None = None,
    play: Play | None = None,
) -> Probed:
    """Probe a rate as the controller does: looked at while it is played, judged when drained.

    Args:
        server: is probed.
        rate_hz: is offered.
        criterion: by default that of a search.
        seconds: the longest time of the probe.
        player_hz: what the player reaches at most.
        arrivals_s: when the steps are published, if not at even intervals.
        play: by default a probe that ends as soon as it is decided.
    """
    criterion = criterion or Criterion(precision=0.02)
    play = play or Play()
    steps = max(MIN_PROBE_STEPS, math.ceil(seconds * rate_hz))
    if play.enough and arrivals_s is None:
        steps = max(steps, min(criterion.messages_without_loss, MAX_LONGER * steps))
    due_s = np.arange(steps) / rate_hz
    published_s = np.arange(steps) / min(rate_hz, player_hz or rate_hz)
    if arrivals_s is not None:
        due_s = published_s = arrivals_s
    playback, monitor = rows(due_s, published_s, *server.answers(published_s))
    looks = plan_interim_looks(steps / rate_hz)
    if not play.ends_on:
        looks = (InterimLook(steps / rate_hz, 1.0),)
    decided: ProbeJudgement | None = None
    stopped_s, ended_at = float(published_s[-1]), looks[-1]
    for look in looks[:-1]:
        now_ns = _ns(look.at_s)
        played = playback[playback["published_ns"] <= now_ns]
        seen = monitor[monitor["received_ns"] <= now_ns]
        found = estimate_probe(rate_hz, played, seen, match(played, seen, "stamp"), now_ns)
        judged = judge_interim(found, criterion, look)
        if (True if judged.keeps_up else judged.holds) in play.ends_on:
            decided, stopped_s, ended_at = judged, look.at_s, look
            break
    # Playing stops there, and the graph answers what is still inside.
    played = playback[playback["published_ns"] <= _ns(stopped_s)]
    rest = monitor[np.isin(monitor["stamp_ns"], played["stamp_ns"])]
    end_ns = max(_ns(stopped_s), int(rest["received_ns"].max()) if rest.size else 0) + 500_000_000
    final = estimate_probe(rate_hz, played, rest, match(played, rest, "stamp"), end_ns)
    judgement = judge_final(
        final,
        criterion,
        ended_at,
        decided,
        whole=play.whole,
        proven_hz=play.proven_hz,
    )
    return Probed(judgement, final.overall, stopped_s, played, rest, final.departures)


@dataclass
class Searching:
    """What a search plays on a simulated graph, and for how long in all.

    Attributes:
        confirm_s: how long the lower end is played; 0 for not at all.
        stages: how many queues there are in a row.
        clock_s: goes on through the whole search; the graph is empty again before each play.
    """

    server: Answering
    criterion: Criterion
    seconds: float = 10.0
    confirm_s: float = 30.0
    stages: int = 1
    played_s: float = 0.0
    clock_s: float = 0.0

    def play(self, rate_hz: float, seconds: float, play: Play) -> ProbeOutcome:
        """Play one rate, as `r2bspec.execute.measurement.rate_probe` does."""
        found = probe(self.server, rate_hz, criterion=self.criterion, seconds=seconds, play=play)
        self.played_s += found.stopped_s
        departures = replace(found.departures, begun_s=self.clock_s)
        left_s = (found.monitor["received_ns"].max() - BEGIN_NS) / 1e9 if found.monitor.size else 0
        self.clock_s += max(found.stopped_s, float(left_s)) + 0.3
        return ProbeOutcome(
            Probe(
                segment="",
                rate_hz=rate_hz,
                delivered_hz=found.delivery.delivered_hz,
                holds=found.judgement.holds,
                reason=found.judgement.reason,
                purpose=play.purpose,
                keeps_up=found.judgement.keeps_up,
                lost_at_most=found.judgement.lost_at_most,
                played_s=found.stopped_s,
            ),
            departures=departures,
            drop_share=found.delivery.drop_share,
        )

    @property
    def budget_s(self) -> float:
        """The time of the whole search."""
        return SEARCH_PROBES * self.seconds + SEARCH_CONFIRMATIONS * self.confirm_s

    def run(self, minimum_hz: float, maximum_hz: float) -> SearchRecord:
        """Search for the peak."""
        never: frozenset[bool] = frozenset()

        def confirm(rate_hz: float, proven_hz: float) -> ProbeOutcome:
            play = Play("confirmation", never, whole=True, enough=True, proven_hz=proven_hz)
            return self.play(rate_hz, self.confirm_s, play)

        def upper(rate_hz: float, needed_s: float) -> ProbeOutcome:
            play = Play("confirmation", frozenset({False}), whole=True)
            seconds = min(max(needed_s, self.seconds), max(self.confirm_s, self.seconds))
            return self.play(rate_hz, seconds, play)

        return PeakSearch(
            minimum_hz,
            maximum_hz,
            self.criterion.precision,
            lambda rate_hz: self.play(rate_hz, self.seconds, Play()),
            long_plays=LongPlays(
                overload=lambda rate_hz: self.play(
                    rate_hz, self.seconds, Play("saturation", never)
                ),
                confirm=confirm if self.confirm_s else None,
                upper=upper if self.confirm_s else None,
                budget_s=OVERLOAD_PROBES * self.seconds,
                search_s=self.budget_s,
                stages=self.stages,
                loss=self.criterion.loss,
            ),
        ).run()


def _ns(seconds: float) -> int:
    return BEGIN_NS + round(seconds * 1e9)


def rows(
    due_s: Times, published_s: Times, numbers: NDArray[np.int64], left_s: Times
) -> tuple[Rows, Rows]:
    """What the player and a monitor record of steps and of the answers to some of them."""
    playback = np.zeros(due_s.size, PLAYBACK_DTYPE)
    playback["stamp_ns"] = _STAMP_NS + np.arange(due_s.size)
    playback["due_ns"] = BEGIN_NS + np.round(due_s * 1e9).astype(np.int64)
    playback["published_ns"] = BEGIN_NS + np.round(published_s * 1e9).astype(np.int64)
    playback["done_ns"] = playback["published_ns"] + 1_000
    monitor = np.zeros(numbers.size, MONITOR_DTYPE)
    monitor["stamp_ns"] = _STAMP_NS + numbers
    monitor["received_ns"] = BEGIN_NS + np.round(left_s * 1e9).astype(np.int64)
    monitor["taken_ns"] = monitor["received_ns"] + 1_000
    return playback, monitor[np.argsort(monitor["received_ns"], kind="stable")]
