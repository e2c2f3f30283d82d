"""A bound on a percentile, by the exact binomial test on single messages.

``latency.p99 < L`` says that at most 1 % of all messages take L or longer. The messages of all
iterations are pooled. A step that was never answered counts as a message on the wrong side of the
limit: otherwise a graph that drops its slowest messages would improve its percentiles.
"""

from __future__ import annotations

import math

import numpy as np

from r2bspec.measure.latency import Seconds
from r2bspec.measure.values import LOSSES_COUNT
from r2bspec.slo.methods.forecast import settle_share
from r2bspec.slo.model import CONFIDENCE, ShareTest
from r2bspec.slo.question import Answer, Question, decide
from r2bspec.slo.statistics.binomial import lower_bound, upper_bound
from r2bspec.slo.statistics.order import allowed_share, percentile_interval
from r2bspec.slo.wording import share_sentence


def judge_percentile(question: Question) -> Answer:
    """Decide a requirement on a percentile; its metric has a quantile."""
    quantile = question.info.quantile
    if quantile is None:
        raise ValueError(f"{question.info.name} is no percentile")
    values, lost = _pooled(question)
    if not values.size:
        return Answer(outcome="inconclusive", method="none", reason="There is nothing to judge.")
    interval = percentile_interval(values, quantile, CONFIDENCE)
    # A floor (> L) fails on the messages that are at or below it: the ceiling's test, negated.
    share = _share_test(question, values, lost, quantile)
    if question.wants_less:
        outcome = decide(
            passes=question.holds(interval.upper), fails=not question.holds(interval.lower)
        )
    else:
        outcome = decide(
            passes=question.holds(interval.lower), fails=not question.holds(interval.upper)
        )
    return Answer(
        outcome=outcome,
        method="exact binomial",
        reason=share_sentence(question, share, outcome),
        settle=settle_share(question, share) if outcome == "inconclusive" else "",
        estimate=interval.estimate,
        lower=interval.lower,
        upper=interval.upper,
        n=values.size,
        over=share.over,
        share=share,
    )


def _pooled(question: Question) -> tuple[Seconds, int]:
    """All messages of all iterations, and how many of them are lost (infinitely off the limit)."""
    family = question.info.family
    if question.info.scope == "playback":
        return np.concatenate([one.playback.lateness for one in question.iterations]), 0
    seen = [one.monitors[question.monitor or ""] for one in question.iterations]
    times = np.concatenate([one.times[family] for one in seen])
    lost = sum(one.missed for one in seen) if family in LOSSES_COUNT else 0
    worst = math.inf if question.wants_less else -math.inf
    return np.concatenate((times, np.full(lost, worst))), lost


def _share_test(question: Question, values: Seconds, lost: int, quantile: float) -> ShareTest:
    """How many messages are on the wrong side of the limit, and how many may be."""
    match question.requirement.op:
        case "<":
            over = int(np.count_nonzero(values >= question.limit))
        case "<=":
            over = int(np.count_nonzero(values > question.limit))
        case ">":
            over = int(np.count_nonzero(values <= question.limit))
        case _:
            over = int(np.count_nonzero(values < question.limit))
    n = values.size
    return ShareTest(
        n=n,
        over=over,
        lost=lost,
        share=over / n,
        lower=lower_bound(over, n, CONFIDENCE),
        upper=upper_bound(over, n, CONFIDENCE),
        allowed=allowed_share(quantile) if question.wants_less else quantile,
    )
