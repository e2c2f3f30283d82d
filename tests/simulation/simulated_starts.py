"""Runs of several starts in a world of worlds: how often a requirement on the limit is decided.

A run is S starts of J iterations of n messages. A message takes about 1, with a normal scatter of
10 % unless a world says otherwise; a world adds what starts, iterations, messages, time or the
machine do to it. Each world knows the distribution of all its messages, so that the limit can be
put exactly on the truth, where a test is wrong most often. The tests are those of the verdicts;
each failure is played again, in fresh starts, and judged at the confidence of a confirmation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy import signal, special
from simulated_gates import (
    CONFIDENCE,
    LOOKS,
    Errors,
    Values,
    percentile_outcome,
    ratio_outcome,
    share_test,
)

from nightly import size
from r2bspec.judge.statistics.effective_sample_size import SampleDesign, effective_sample
from r2bspec.judge.statistics.percentile_interval import RankedMessages, percentile_interval
from r2bspec.judge.statistics.t_interval import (
    RunValues,
    hierarchical_interval,
    welch_ratio_of_runs,
)
from r2bspec.language.benchmark_defaults import CONFIRMATION_CONFIDENCE

Parts = tuple[tuple[float, float, float], ...]

SCATTER = 0.1


@dataclass(frozen=True)
class Shape:
    """The size of a run."""

    starts: int = 5
    iterations: int = 2
    messages: int = 300

    @property
    def pieces(self) -> int:
        return self.starts * self.iterations

    @property
    def numbers(self) -> tuple[int, ...]:
        return tuple(np.repeat(np.arange(1, self.starts + 1), self.iterations).tolist())


DEFAULT = Shape()


@dataclass(frozen=True)
class StartWorld:
    """What differs, in shares of a message's time.

    Attributes:
        start: standard deviation of the level of a start.
        iteration: of an iteration.
        hour: of everything in a run.
        start_memory: correlation of successive starts; AR(1).
        iteration_memory: of successive iterations, across starts.
        message_memory: of successive messages of an iteration.
        drift: from the beginning of a run to its end.
        slow_starts: share of starts that are slower by a fifth.
        slow_iterations: share of iterations that are.
        burst: mean length of stalls, in which messages take twice as long; 2 % of all messages.
        skewed: whether messages are log-normal with sigma 1, and nothing else.
    """

    start: float = 0.0
    iteration: float = 0.0
    hour: float = 0.0
    start_memory: float = 0.0
    iteration_memory: float = 0.0
    message_memory: float = 0.0
    drift: float = 0.0
    slow_starts: float = 0.0
    slow_iterations: float = 0.0
    burst: float = 0.0
    skewed: bool = False

    def run(self, random: np.random.Generator, shape: Shape) -> Values:
        """One run, shape (iterations, messages)."""
        m, n = shape.pieces, shape.messages
        if self.skewed:
            return np.exp(random.standard_normal((m, n)))
        level = 1 + self.hour * random.standard_normal() + np.zeros(m)
        starts = self.start * _ar(random, self.start_memory, shape.starts)
        starts = starts + 0.2 * (random.random(shape.starts) < self.slow_starts)
        level += np.repeat(starts, shape.iterations)
        level += self.iteration * _ar(random, self.iteration_memory, m)
        level += 0.2 * (random.random(m) < self.slow_iterations)
        noise = _ar(random, self.message_memory, n, m)
        values = level[:, np.newaxis] + SCATTER * noise
        if self.drift:
            values += self.drift * (np.arange(m * n).reshape(m, n) / (m * n - 1) - 0.5)
        if self.burst:
            values += _stalls(random, self.burst, (m, n))
        return np.asarray(values)

    @property
    def parts(self) -> Parts:
        """The distribution of all messages, as normal parts: weight, mean, deviation."""
        deviation = math.sqrt(SCATTER**2 + self.start**2 + self.iteration**2 + self.hour**2)
        if self.drift:
            steps = (np.arange(400) + 0.5) / 400 - 0.5
            return tuple((1 / 400, 1 + self.drift * at, deviation) for at in steps.tolist())
        slow, by = max(self.slow_starts, self.slow_iterations), 0.2
        if self.burst:
            slow, by = _STALLED, 1.0
        return ((1 - slow, 1.0, deviation), (slow, 1.0 + by, deviation))

    @property
    def mean(self) -> float:
        """The true mean."""
        return math.exp(0.5) if self.skewed else sum(w * mean for w, mean, _ in self.parts)

    def quantile(self, q: float) -> float:
        """The true percentile."""
        if self.skewed:
            return math.exp(float(special.ndtri(q)))
        low, high = -5.0, 10.0
        for _ in range(60):
            middle = (low + high) / 2
            below = sum(w * float(special.ndtr((middle - mu) / s)) for w, mu, s in self.parts)
            low, high = (middle, high) if below < q else (low, middle)
        return high


_STALLED = 0.02


def _ar(random: np.random.Generator, phi: float, length: int, rows: int | None = None) -> Values:
    """Standard normal values, each correlated with the one before."""
    warm_up = 0 if not phi else math.ceil(6 / (1 - phi))
    noise = random.standard_normal((rows or 1, length + warm_up))
    if phi:
        noise = signal.lfilter([math.sqrt(1 - phi * phi)], [1, -phi], noise, axis=1)[:, warm_up:]
    return np.asarray(noise if rows else noise[0])


def _stalls(random: np.random.Generator, length: float, shape: tuple[int, int]) -> Values:
    """1 in a stall, 0 outside: a two-state Markov chain."""
    draws = random.random(shape)
    enter = _STALLED / (1 - _STALLED) / length
    found = np.empty(shape)
    state = random.random(shape[0]) < _STALLED
    for step in range(shape[1]):
        found[:, step] = state
        state = np.where(state, draws[:, step] >= 1 / length, draws[:, step] < enter)
    return found


WORLDS: dict[str, StartWorld] = {
    "nothing differs": StartWorld(),
    "starts differ by 0.5 %": StartWorld(start=0.005, iteration=0.01),
    "starts differ by 1 %": StartWorld(start=0.01, iteration=0.01),
    "starts differ by 2.7 %": StartWorld(start=0.027, iteration=0.01),
    "iterations differ by 2.7 %": StartWorld(iteration=0.027),
    "both differ by 2.7 %": StartWorld(start=0.027, iteration=0.027),
    "drift of 6 % through the run": StartWorld(drift=0.06, iteration=0.01),
    "messages resemble (0.9)": StartWorld(message_memory=0.9),
    "messages resemble (0.99)": StartWorld(message_memory=0.99),
    "iterations resemble (0.5), 5 %": StartWorld(iteration=0.05, iteration_memory=0.5),
    "iterations resemble (0.8), 5 %": StartWorld(iteration=0.05, iteration_memory=0.8),
    "starts resemble (0.5), 2.7 %": StartWorld(start=0.027, iteration=0.01, start_memory=0.5),
    "stalls of 5 messages": StartWorld(burst=5),
    "stalls of 20 messages": StartWorld(burst=20),
    "stalls of 40 messages": StartWorld(burst=40),
    "1 iteration in 10 is slow": StartWorld(slow_iterations=0.1),
    "1 start in 5 is slow": StartWorld(slow_starts=0.2),
    "skewed messages (log-normal)": StartWorld(skewed=True),
    "the hour differs by 2.7 %": StartWorld(hour=0.027),
}

WINDOWS = "90 % of 1 s windows"
_WINDOW = 30
"""Messages of a window."""
_WINDOW_SHARE = 0.9

QUANTITIES = ("p50", "p99", "drop rate 1 %", "mean, throughput")
QUANTILES = {"p50": 0.5, "p90": 0.9, "p99": 0.99}


def outcome(
    values: Values, shape: Shape, quantity: str, limit: float, confidence: float = CONFIDENCE
) -> int:
    """1 for a pass, -1 for a fail, 0 if it stays open."""
    if quantity == "mean, throughput":
        found = hierarchical_interval(
            values.mean(axis=1).tolist(), shape.numbers[: len(values)], confidence
        )
        return int(found.interval.upper < limit) - int(found.interval.lower >= limit)
    starts = shape.numbers[: len(values)]
    if quantity == WINDOWS:
        design = SampleDesign(starts, round(1 - _WINDOW_SHARE, 12), confidence)
        ranked = RankedMessages(list(window_means(values)), design)
        interval = percentile_interval(ranked, _WINDOW_SHARE, confidence)
        return int(interval.upper < limit) - int(interval.lower >= limit)
    allowed = round(1 - QUANTILES.get(quantity, 0.99), 12)
    if quantity == "drop rate 1 %":
        design = SampleDesign(starts, allowed, confidence)
        sample = effective_sample(list(values > limit), design)
        return share_test(sample.bad_messages, sample.messages, allowed, confidence)
    return percentile_outcome(values, limit, allowed, confidence, starts)


_TRUTH_RUNS = size(400, 4000)


def window_means(values: Values) -> Values:
    """The mean of each window, shape (iterations, windows): as throughput, a rate of its own."""
    return np.asarray(values.reshape(len(values), -1, _WINDOW).mean(axis=2))


def limit_of(world: StartWorld, quantity: str) -> float:
    """The truth."""
    if quantity == "mean, throughput":
        return world.mean
    if quantity == WINDOWS:
        # Windows have no closed form in all worlds: the truth is that of many runs.
        random = np.random.default_rng(99)
        means = [window_means(world.run(random, DEFAULT)) for _ in range(_TRUTH_RUNS)]
        return float(np.quantile(np.concatenate(means), _WINDOW_SHARE))
    return world.quantile(QUANTILES.get(quantity, 0.99))


def errors(
    world: StartWorld,
    quantities: tuple[str, ...] = QUANTITIES,
    *,
    shape: Shape = DEFAULT,
    runs: int,
    looks: bool = False,
) -> dict[str, Errors]:
    """Judge many runs, exactly on the limit, and play failures again."""
    random = np.random.default_rng(1)
    limits = {quantity: limit_of(world, quantity) for quantity in quantities}
    found = {quantity: Errors(runs) for quantity in quantities}
    ends = {shape.pieces: CONFIDENCE}
    if looks:
        ends = {end: LOOKS.confidence_at(at) for at, end in enumerate(LOOKS.iterations, start=1)}
    for _ in range(runs):
        values = world.run(random, shape)
        again: Values | None = None
        for quantity, limit in limits.items():
            first, end = 0, 0
            for end, confidence in ends.items():
                first = outcome(values[:end], shape, quantity, limit, confidence)
                if first:
                    break
            if first < 0 and again is None:
                again = world.run(random, shape)
            fresh = values if again is None else again
            confirm = partial(outcome, fresh[:end], shape, quantity, limit, CONFIRMATION_CONFIDENCE)
            found[quantity].add(first, confirm)
    return found


def stored_errors(world: StartWorld, shape: Shape, *, by_starts: bool = True, runs: int) -> Errors:
    """Two stored runs of one graph by Welch's test, with or without regard to their starts."""
    random = np.random.default_rng(1)
    starts = shape.numbers if by_starts else ()

    def stored() -> RunValues:
        return RunValues(world.run(random, shape).mean(axis=1).tolist(), starts)

    return Errors.of(
        ratio_outcome(welch_ratio_of_runs(stored(), stored(), CONFIDENCE)[0]) for _ in range(runs)
    )
