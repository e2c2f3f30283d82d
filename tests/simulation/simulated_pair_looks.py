"""Pairs of a steady base and a head that does something rarely, judged after each pair or once.

The ratio of each pair is that of two whole runs, each with a start of its own. The limit is the
ratio that pairs have in the mean of their logarithms, so that the truth is exactly on it.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from simulated_gates import CONFIDENCE, Errors, ratio_outcome
from simulated_starts import QUANTILES, Shape, StartWorld

from nightly import size
from r2bspec.judge.statistics.rule_of_three import zero_failure_bound
from r2bspec.judge.statistics.t_interval import RatioInterval, paired_ratio
from r2bspec.judge.unmet import decided_in_bursts, room_of_mean
from r2bspec.plan.interim_looks import InterimLooks

PAIR_RUN = Shape(1, 2, 300)
STEADY = StartWorld(start=0.019, iteration=0.01)
HEADS: dict[str, StartWorld] = {
    "as the base": STEADY,
    "1 start in 5 is slow": StartWorld(start=0.019, iteration=0.01, slow_starts=0.2),
    "stalls of 40 messages": StartWorld(start=0.019, iteration=0.01, burst=40),
}
"""Two runs of the base differ by 2.7 %."""

_TRUTH_PAIRS = size(300, 4000)


def _value(world: StartWorld, random: np.random.Generator, quantity: str) -> float:
    values = world.run(random, PAIR_RUN)
    quantile = QUANTILES.get(quantity)
    return float(values.mean() if quantile is None else np.quantile(values, quantile))


@cache
def _truth(head: str, quantity: str) -> float:
    if HEADS[head] is STEADY:
        return 1.0
    random = np.random.default_rng(99)
    logs = [
        [math.log(_value(world, random, quantity)) for _ in range(_TRUTH_PAIRS)]
        for world in (HEADS[head], STEADY)
    ]
    return math.exp(float(np.mean(logs[0]) - np.mean(logs[1])))


def has_room(
    interval: RatioInterval, limit: float, quantity: str, confidence: float, found: int
) -> bool:
    """Return True if pairs may end before the last, as `early_doubt_of_pairs` has it."""
    quantile, below = QUANTILES.get(quantity), found > 0
    if quantile is not None:
        messages = interval.n * PAIR_RUN.pieces * PAIR_RUN.messages
        if not decided_in_bursts(0, messages, round(1 - quantile, 12), confidence, below=True):
            return False
    unmet = zero_failure_bound(interval.n, CONFIDENCE)
    return unmet <= room_of_mean(interval.upper if below else interval.lower, limit, below=below)


def errors_of_pairs(
    head: str, quantity: str, pairs: int, *, looks: bool = True, room: bool = True, runs: int
) -> Errors:
    """Passes and fails of ``<= LIMIT of baseline``, exactly on the limit.

    Args:
        head: one of `HEADS`.
        quantity: ``p50``, ``p99`` or ``mean``.
        pairs: the most.
        looks: whether the pairs end after the one that decides; all are judged at once otherwise.
        room: whether a decision needs room for what these pairs have not met.
        runs: how many.
    """
    random, limit = np.random.default_rng(3), _truth(head, quantity)
    planned = InterimLooks.after_each_pair(pairs) if looks else InterimLooks((pairs,), pairs)

    def outcome() -> int:
        base, head_ = (
            [_value(world, random, quantity) for _ in range(pairs)]
            for world in (STEADY, HEADS[head])
        )
        for look, end in enumerate(planned.iterations, start=1):
            confidence = planned.confidence_at(look, CONFIDENCE)
            interval = paired_ratio(base[:end], head_[:end], confidence)
            found = -ratio_outcome(interval, limit)
            early = room and end < pairs
            if found and not (early and not has_room(interval, limit, quantity, confidence, found)):
                return found
        return 0

    return Errors.of(outcome() for _ in range(runs))
