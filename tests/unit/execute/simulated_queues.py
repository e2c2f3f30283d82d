"""Single servers with a queue, simulated: what a player and a monitor would have recorded."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from r2bspec.execute.holding import Criterion, Judgement, judge_finished_probe, judge_probe
from r2bspec.measure.delivery import Delivery, delivery
from r2bspec.measure.matching import match
from r2bspec.record.arrays import MONITOR, PLAYBACK, Rows

_BEGIN_NS = 7_000_000_000_000_000
_STAMP_NS = 1_800_000_000_000_000_000
_WATCH_S = 0.25

DEEP = 1_000_000
SHALLOW = 10


@dataclass(frozen=True)
class Server:
    """A server and the queue before it.

    Attributes:
        capacity_hz: messages that it serves per second, on average.
        depth: messages that may wait; the oldest one makes room for a new one, as in ROS.
        spread: 0 for equal service times, 1 for exponential ones.
        loses: of the messages that come, the share that is lost at once.
        stalls: (from, to) in seconds: nothing is begun in this time.
    """

    capacity_hz: float
    depth: int = DEEP
    spread: float = 0.0
    loses: float = 0.0
    stalls: tuple[float, float] = (0.0, 0.0)
    seed: int = 0
    random: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "random", np.random.default_rng(self.seed))

    def answers(self, arrivals_s: NDArray[np.float64]) -> dict[int, float]:
        """When each message that is not lost leaves, in seconds, by its number."""
        mean_s = 1.0 / self.capacity_hz
        times_s = mean_s * (
            (1.0 - self.spread) + self.spread * self.random.exponential(size=arrivals_s.size)
        )
        lost = self.random.random(arrivals_s.size) < self.loses
        waiting: deque[int] = deque()
        answers: dict[int, float] = {}
        free_s = 0.0

        def serve(until_s: float) -> None:
            nonlocal free_s
            while waiting:
                begin_s = max(free_s, float(arrivals_s[waiting[0]]))
                if self.stalls[0] <= begin_s < self.stalls[1]:
                    begin_s = self.stalls[1]
                if begin_s > until_s:
                    return
                number = waiting.popleft()
                free_s = begin_s + float(times_s[number])
                answers[number] = free_s

        for number, arrival_s in enumerate(arrivals_s):
            serve(float(arrival_s))
            if not lost[number]:
                waiting.append(number)
                if len(waiting) > self.depth:
                    waiting.popleft()
        serve(np.inf)
        return answers


@dataclass(frozen=True)
class Probed:
    """How a probe ended: what was judged, after how long, and from how many steps."""

    judgement: Judgement
    delivery: Delivery
    stopped_s: float
    steps: int


def probe(
    server: Server,
    rate_hz: float,
    *,
    criterion: Criterion | None = None,
    seconds: float = 3.0,
    player_hz: float | None = None,
) -> Probed:
    """Probe a rate as the controller does: watched while it is played, judged when drained."""
    criterion = criterion or Criterion(precision=0.02)
    steps = max(20, round(seconds * rate_hz))
    due_s = np.arange(steps) / rate_hz
    published_s = np.arange(steps) / min(rate_hz, player_hz or rate_hz)
    answers = server.answers(published_s)
    playback, monitor = _rows(due_s, published_s, answers)
    now_s = _WATCH_S
    while now_s < published_s[-1]:
        seen = _delivery(rate_hz, playback, monitor, now_s)
        if judge_probe(seen, criterion, now_s).holds is not None:
            break
        now_s += _WATCH_S
    # Playing stops there, and the graph answers what is still inside.
    played = playback[playback["published_ns"] <= _ns(now_s)]
    rest = server_rest(monitor, played)
    end_s = max(now_s, float((rest["received_ns"].max() - _BEGIN_NS) / 1e9) if rest.size else 0.0)
    final = _delivery(rate_hz, played, rest, end_s + 0.5)
    return Probed(judge_finished_probe(final, criterion), final, now_s, int(played.size))


def server_rest(monitor: Rows, played: Rows) -> Rows:
    """Of the answers, those to what was played."""
    return monitor[np.isin(monitor["stamp_ns"], played["stamp_ns"])]


def _ns(seconds: float) -> int:
    return _BEGIN_NS + round(seconds * 1e9)


def _rows(
    due_s: NDArray[np.float64], published_s: NDArray[np.float64], answers: dict[int, float]
) -> tuple[Rows, Rows]:
    playback = np.zeros(due_s.size, PLAYBACK)
    playback["stamp_ns"] = _STAMP_NS + np.arange(due_s.size)
    playback["due_ns"] = _BEGIN_NS + np.round(due_s * 1e9).astype(np.int64)
    playback["published_ns"] = _BEGIN_NS + np.round(published_s * 1e9).astype(np.int64)
    playback["done_ns"] = playback["published_ns"] + 1_000
    monitor = np.zeros(len(answers), MONITOR)
    numbers = np.fromiter(answers, dtype=np.int64, count=len(answers))
    left_s = np.fromiter(answers.values(), dtype=np.float64, count=len(answers))
    monitor["stamp_ns"] = _STAMP_NS + numbers
    monitor["received_ns"] = _BEGIN_NS + np.round(left_s * 1e9).astype(np.int64)
    monitor["taken_ns"] = monitor["received_ns"] + 1_000
    return playback, monitor[np.argsort(monitor["received_ns"], kind="stable")]


def _delivery(rate_hz: float, playback: Rows, monitor: Rows, now_s: float) -> Delivery:
    played = playback[playback["published_ns"] <= _ns(now_s)]
    seen = monitor[monitor["received_ns"] <= _ns(now_s)]
    return delivery(rate_hz, played, seen, match(played, seen, "stamp"), _ns(now_s))
