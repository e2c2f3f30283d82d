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
    Errors,
    Values,
    percentile_outcome,
    ratio_outcome,
    share_bounds_of,
    share_outcome,
)

from nightly import size
from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.pipeline import judge
from r2bspec.judge.statistics.percentile_interval import RankedMessages, percentile_interval
from r2bspec.judge.statistics.rule_of_three import zero_failure_bound
from r2bspec.judge.statistics.shares import ShareLimit
from r2bspec.judge.statistics.t_interval import (
    hierarchical_interval,
    scatter_level,
    welch_ratio_of_runs,
)
from r2bspec.judge.unmet import decided_in_bursts, room_of_losses, room_of_mean, room_of_percentile
from r2bspec.judge.verdict import Verdict
from r2bspec.language.benchmark_defaults import CONFIRMATION_CONFIDENCE
from r2bspec.plan.interim_looks import InterimLooks
from run_simulation import objective
from simulated_runs import run_of

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
        slow_starts: share of starts that are slower.
        slow_iterations: share of iterations that are.
        slower: by how much.
        burst: mean length of stalls, in which messages take twice as long; 2 % of all messages.
        lost_burst: mean length of bursts of losses; 1 % of all messages.
        lost_first: share of starts that lose their first messages; 1 % of all messages.
        stop: length of stops of the machine in seconds, one every `EVERY_S` on average; a message
            takes 20 ms, and what comes during a stop waits for its end.
        skewed: messages are log-normal with this sigma, and nothing else.
        pareto: messages are Pareto with this index, and nothing else.
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
    slower: float = 0.2
    burst: float = 0.0
    lost_burst: float = 0.0
    lost_first: float = 0.0
    stop: float = 0.0
    skewed: float = 0.0
    pareto: float = 0.0

    def run(self, random: np.random.Generator, shape: Shape) -> Values:
        """One run, shape (iterations, messages)."""
        m, n = shape.pieces, shape.messages
        if self.skewed:
            return np.exp(self.skewed * random.standard_normal((m, n)))
        if self.pareto:
            return 1 + random.pareto(self.pareto, (m, n))
        level = 1 + self.hour * random.standard_normal() + np.zeros(m)
        starts = self.start * _ar(random, self.start_memory, shape.starts)
        starts = starts + self.slower * (random.random(shape.starts) < self.slow_starts)
        level += np.repeat(starts, shape.iterations)
        level += self.iteration * _ar(random, self.iteration_memory, m)
        level += self.slower * (random.random(m) < self.slow_iterations)
        noise = _ar(random, self.message_memory, n, m)
        values = level[:, np.newaxis] + SCATTER * noise
        if self.drift:
            values += self.drift * (np.arange(m * n).reshape(m, n) / (m * n - 1) - 0.5)
        if self.burst:
            values += _stalls(random, self.burst, (m, n), _STALLED)
        if self.lost_burst:
            values += LOST * _stalls(random, self.lost_burst, (m, n), _LOST_SHARE)
        if self.lost_first:
            whole = values.reshape(shape.starts, -1)
            first = round(_LOST_SHARE / self.lost_first * whole.shape[1])
            whole[random.random(shape.starts) < self.lost_first, :first] += LOST
        if self.stop:
            values += _stops(random, self.stop, (m, n)) / MESSAGE_S
        return np.asarray(values)

    @property
    def parts(self) -> Parts:
        """The distribution of all messages, as normal parts: weight, mean, deviation."""
        deviation = math.sqrt(SCATTER**2 + self.start**2 + self.iteration**2 + self.hour**2)
        if self.drift:
            steps = (np.arange(400) + 0.5) / 400 - 0.5
            return tuple((1 / 400, 1 + self.drift * at, deviation) for at in steps.tolist())
        if self.stop:
            held, steps = self.stop / EVERY_S, ((np.arange(100) + 0.5) / 100).tolist()
            late = tuple((held / 100, 1 + at * self.stop / MESSAGE_S, deviation) for at in steps)
            return ((1 - held, 1.0, deviation), *late)
        slow, by = max(self.slow_starts, self.slow_iterations), self.slower
        if self.burst:
            slow, by = _STALLED, 1.0
        if self.lost_burst or self.lost_first:
            slow, by = _LOST_SHARE, LOST
        return ((1 - slow, 1.0, deviation), (slow, 1.0 + by, deviation))

    @property
    def mean(self) -> float:
        """The true mean."""
        if self.pareto:
            return self.pareto / (self.pareto - 1)
        if self.skewed:
            return math.exp(self.skewed**2 / 2)
        return sum(w * mean for w, mean, _ in self.parts)

    def quantile(self, q: float) -> float:
        """The true percentile."""
        if self.skewed:
            return math.exp(self.skewed * float(special.ndtri(q)))
        if self.pareto:
            return float((1 - q) ** (-1 / self.pareto))
        low, high = -5.0, 10.0
        for _ in range(60):
            middle = (low + high) / 2
            below = sum(w * float(special.ndtr((middle - mu) / s)) for w, mu, s in self.parts)
            low, high = (middle, high) if below < q else (low, middle)
        return high


_STALLED = 0.02
_LOST_SHARE = 0.01
LOST = 10.0
"""What a message that is lost takes longer."""
MESSAGE_S, RATE_HZ, EVERY_S = 0.02, 30.0, 30.0


def _ar(random: np.random.Generator, phi: float, length: int, rows: int | None = None) -> Values:
    """Standard normal values, each correlated with the one before."""
    warm_up = 0 if not phi else math.ceil(6 / (1 - phi))
    noise = random.standard_normal((rows or 1, length + warm_up))
    if phi:
        noise = signal.lfilter([math.sqrt(1 - phi * phi)], [1, -phi], noise, axis=1)[:, warm_up:]
    return np.asarray(noise if rows else noise[0])


def _stalls(
    random: np.random.Generator, length: float, shape: tuple[int, int], share: float
) -> Values:
    """1 in a stall, 0 outside: a two-state Markov chain."""
    draws = random.random(shape)
    enter = share / (1 - share) / length
    found = np.empty(shape)
    state = random.random(shape[0]) < share
    for step in range(shape[1]):
        found[:, step] = state
        state = np.where(state, draws[:, step] >= 1 / length, draws[:, step] < enter)
    return found


def _stops(random: np.random.Generator, length_s: float, shape: tuple[int, int]) -> Values:
    """For how long each message waits for the end of a stop, in seconds."""
    times_s = np.arange(shape[1]) / RATE_HZ
    found = np.zeros(shape)
    span_s = times_s[-1] + 1 / RATE_HZ + length_s
    for waits in found:
        begins_s = random.uniform(-length_s, span_s - length_s, random.poisson(span_s / EVERY_S))
        for begin_s in begins_s:
            left_s = np.where(times_s >= begin_s, begin_s + length_s - times_s, 0.0)
            np.maximum(waits, left_s, out=waits)
    return found


WORLDS: dict[str, StartWorld] = {
    "nothing differs": StartWorld(),
    "starts differ by 0.5 %": StartWorld(start=0.005, iteration=0.01),
    "starts differ by 1 %": StartWorld(start=0.01, iteration=0.01),
    "starts differ by 2.7 %": StartWorld(start=0.027, iteration=0.01),
    "starts differ by 5 %": StartWorld(start=0.05, iteration=0.01),
    "starts differ by 10 %": StartWorld(start=0.1, iteration=0.01),
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
    "a stop of 0.5 s every 30 s": StartWorld(stop=0.5),
    "1 iteration in 10 is slow": StartWorld(slow_iterations=0.1),
    "1 start in 5 is slow": StartWorld(slow_starts=0.2),
    "skewed messages (log-normal)": StartWorld(skewed=1.0),
    "the hour differs by 2.7 %": StartWorld(hour=0.027),
}

RARE_WORLDS: dict[str, StartWorld] = {
    "2 starts in 10 are 30 % slower": StartWorld(start=0.01, slow_starts=0.2, slower=0.3),
    "half of the starts are 10 % slower": StartWorld(start=0.01, slow_starts=0.5, slower=0.1),
    "starts resemble (0.6), 10 %": StartWorld(start=0.1, start_memory=0.6),
    "starts resemble (0.9), 5 %": StartWorld(start=0.05, start_memory=0.9),
    "losses in bursts of 5": StartWorld(lost_burst=5),
    "losses in bursts of 20": StartWorld(lost_burst=20),
    "losses in bursts of 60": StartWorld(lost_burst=60),
    "1 start in 5 loses its first messages": StartWorld(lost_first=0.2),
    "log-normal, sigma 1.5": StartWorld(skewed=1.5),
    "Pareto, index 1.5": StartWorld(pareto=1.5),
    "Pareto, index 1.1": StartWorld(pareto=1.1),
}
"""Worlds in which a run of five starts may not meet what decides."""

QUANTITIES = ("p50", "p99", "drop rate 1 %", "mean, throughput")


def quantities_of(name: str) -> tuple[str, ...]:
    """What is judged in a world: nothing but losses where these are what it is about."""
    return ("drop rate 1 %",) if "los" in name else QUANTITIES


QUANTILES = {"p50": 0.5, "p90": 0.9, "p99": 0.99}


def outcome(
    values: Values, shape: Shape, quantity: str, limit: float, confidence: float = CONFIDENCE
) -> int:
    """1 for a pass, -1 for a fail, 0 if it stays open."""
    starts, level = shape.numbers[: len(values)], scatter_level(confidence)
    if quantity == "mean, throughput":
        found = hierarchical_interval(values.mean(axis=1).tolist(), starts, level)
        return int(found.interval.upper < limit) - int(found.interval.lower >= limit)
    allowed = round(1 - QUANTILES.get(quantity, 0.99), 12)
    if quantity == "drop rate 1 %":
        return share_outcome(values > limit, allowed, confidence, starts)
    return percentile_outcome(values, limit, allowed, confidence, starts)


_TRUTH_RUNS = size(400, 4000)


def limit_of(world: StartWorld, quantity: str) -> float:
    """The truth."""
    if quantity == "mean, throughput":
        return world.mean
    return world.quantile(QUANTILES.get(quantity, 0.99))


def errors(
    world: StartWorld,
    quantities: tuple[str, ...] = QUANTITIES,
    *,
    shape: Shape = DEFAULT,
    runs: int,
    looks: bool = False,
    said: bool = False,
) -> dict[str, Errors]:
    """Judge many runs, exactly on the limit, and play failures again.

    Args:
        world: that they are of.
        quantities: that are judged.
        shape: of a run.
        runs: how many.
        looks: whether a run ends after the start that decides; all are judged whole otherwise.
        said: whether to count the decisions that say what the run may not have met.
    """
    planned = planned_looks(shape, looks=looks)
    random = np.random.default_rng(1)
    limits = {quantity: limit_of(world, quantity) for quantity in quantities}
    found = {quantity: Errors(runs) for quantity in quantities}
    for _ in range(runs):
        values = world.run(random, shape)
        again: Values | None = None
        for quantity, limit in limits.items():
            first = _at_looks(values, shape, planned, quantity, limit, CONFIDENCE)
            if first < 0 and again is None:
                again = world.run(random, shape)
            fresh = values if again is None else again
            confidence = CONFIRMATION_CONFIDENCE
            confirm = partial(_at_looks, fresh, shape, planned, quantity, limit, confidence)
            found[quantity].add(first, confirm)
            if said and first:
                verdict = verdict_on(values, quantity, limit, shape)
                found[quantity].said += bool(verdict.requirements[0].untested)
    return found


def planned_looks(shape: Shape, *, looks: bool, declared: int = 0) -> InterimLooks:
    """The looks at a run, or the only one at its end; all iterations are declared by default."""
    if looks:
        declared = declared or shape.pieces
        return InterimLooks.planned(declared, declared // shape.iterations, shape.pieces)
    return InterimLooks((shape.pieces,))


def _at_looks(
    values: Values,
    shape: Shape,
    looks: InterimLooks,
    quantity: str,
    limit: float,
    confidence: float,
) -> int:
    """The first decision at a look."""
    return _decided_at(values, shape, looks, quantity, limit, confidence)[0]


def _decided_at(
    values: Values,
    shape: Shape,
    looks: InterimLooks,
    quantity: str,
    limit: float,
    confidence: float,
) -> tuple[int, int]:
    """The first decision at a look, and after how many iterations; after all if there is none."""
    for look, end in enumerate(looks.iterations, start=1):
        at, played = looks.confidence_at(look, confidence), values[:end]
        found = outcome(played, shape, quantity, limit, at)
        early = end < looks.declared
        if found and not (early and not has_room(played, shape, quantity, limit, at, found)):
            return found, end
    return 0, looks.iterations[-1]


def has_room(
    values: Values, shape: Shape, quantity: str, limit: float, confidence: float, found: int
) -> bool:
    """Whether a decision may end a run before its declared starts, as `early_doubt` has it."""
    numbers, below = shape.numbers[: len(values)], found > 0
    unmet = zero_failure_bound(len(set(numbers)), CONFIDENCE)
    if quantity == "mean, throughput":
        level = scatter_level(confidence)
        interval = hierarchical_interval(values.mean(axis=1).tolist(), numbers, level).interval
        bound = interval.upper if below else interval.lower
        return unmet <= room_of_mean(bound, limit, below=below)
    allowed = round(1 - QUANTILES.get(quantity, 0.99), 12)
    over = int(np.count_nonzero(values > limit))
    if not decided_in_bursts(over, values.size, allowed, confidence, below=below):
        return False
    if quantity == "drop rate 1 %":
        bounds = share_bounds_of(values > limit, allowed, confidence, numbers)
        bound = bounds.upper if below else bounds.lower
        return unmet <= room_of_losses(bound, allowed, below=below)
    ranked = RankedMessages(
        list(values), numbers, ShareLimit(allowed, confidence, scatter_level(confidence))
    )
    interval_ = percentile_interval(ranked, 1 - allowed)
    bound = interval_.upper if below else interval_.lower
    return unmet <= min(
        room_of_percentile(list(values), limit, allowed, below=below),
        room_of_mean(bound, limit, below=below),
    )


FACTOR = 1.15


def right_away_from_the_limit(world: StartWorld, quantity: str, *, runs: int) -> float:
    """The share of runs with the right verdict where the limit is 15 % above or below the truth."""
    random, limit = np.random.default_rng(2), limit_of(world, quantity)
    looks = planned_looks(DEFAULT, looks=True)
    right = 0
    for _ in range(runs):
        values = world.run(random, DEFAULT)
        for at, wanted in ((limit * FACTOR, 1), (limit / FACTOR, -1)):
            right += _at_looks(values, DEFAULT, looks, quantity, at, CONFIDENCE) == wanted
    return right / (2 * runs)


START_S = 22.0
"""How long a start of the default takes: it comes up, warms up, and plays two iterations."""


@dataclass(frozen=True)
class TimeToVerdict:
    """How many runs decide, and after how many starts, at a distance from the limit.

    Attributes:
        decided: the share of runs with the right verdict.
        starts: the mean number of starts that were played.
    """

    decided: float
    starts: float

    @property
    def seconds(self) -> float:
        return START_S * self.starts


def time_to_verdict(
    distance: float, starts: int, most: int = 0, *, looks: bool = True, runs: int
) -> TimeToVerdict:
    """A mean that is so many deviations between starts from its limit, on either side by turns.

    Args:
        distance: in standard deviations between starts.
        starts: that are declared.
        most: to how many a run that is open is extended; `starts` if that is more.
        looks: whether there are interim looks; all starts are judged at once otherwise.
        runs: how many.
    """
    world, shape = WORLDS["starts differ by 2.7 %"], Shape(max(starts, most))
    random, quantity = np.random.default_rng(1), "mean, throughput"
    planned = planned_looks(shape, looks=looks, declared=starts * shape.iterations)
    played, decided = 0, 0
    for number in range(runs):
        values, side = world.run(random, shape), 1 if number % 2 else -1
        limit = 1 + side * world.start * distance
        found, end = _decided_at(values, shape, planned, quantity, limit, CONFIDENCE)
        played += end // shape.iterations
        decided += found == side
    return TimeToVerdict(decided / runs, played / runs)


def verdict_on(
    values: Values,
    quantity: str,
    limit: float,
    shape: Shape = DEFAULT,
    *,
    looks: InterimLooks | None = None,
) -> Verdict:
    """The verdict on a run with these messages, of which one takes 20 ms.

    Args:
        values: of one run, shape (iterations, messages).
        quantity: on which there is a requirement.
        limit: its limit.
        shape: of the run.
        looks: at which the run is judged; once if None.
    """
    latency, metric = values * 0.02, quantity.partition(",")[0]
    text = f"latency.{metric} < {limit * 20:.6f} ms"
    if quantity == "drop rate 1 %":
        latency, text = np.where(values > limit, np.nan, latency), "drop_rate <= 1 %"
    run = run_of(latency, shape.numbers)
    return judge({"slo": objective(text)}, run, DecisionPolicy(looks=looks))


def stored_errors(world: StartWorld, shape: Shape, *, by_starts: bool = True, runs: int) -> Errors:
    """Two stored runs of one graph by Welch's test, with or without regard to their starts."""
    random = np.random.default_rng(1)
    starts = shape.numbers if by_starts else ()

    def stored() -> list[float]:
        values: list[float] = world.run(random, shape).mean(axis=1).tolist()
        return values

    return Errors.of(
        ratio_outcome(welch_ratio_of_runs(stored(), stored(), (starts, starts), CONFIDENCE))
        for _ in range(runs)
    )
