"""A bound on a percentile, by the exact binomial test on single messages.

``latency.p99 < L`` says that at most 1 % of all messages take L or longer. The messages of all
iterations are pooled, with their effective sample size
(`r2bspec.judge.statistics.effective_sample_size`). A lost message counts as on the wrong side of
the limit: otherwise a graph that drops its slowest messages would improve its percentiles.

The bounds are also at least as far from the percentile as iterations and starts differ
(`r2bspec.judge.statistics.level_interval`). Where only that leaves the verdict open, it says so.
"""

from __future__ import annotations

import math

import numpy as np

from r2bspec.judge.decision import Answer, Decider, Question, decide
from r2bspec.judge.evidence_limits import correlation_notes, share_notes
from r2bspec.judge.methods.forecast import levels_remedy, share_remedy
from r2bspec.judge.statistics.binomial import burst_tolerance, lower_bound, upper_bound
from r2bspec.judge.statistics.order_statistics import (
    PercentileInterval,
    RankedMessages,
    allowed_share,
    percentile_interval,
)
from r2bspec.judge.verdict import Outcome, ShareTest
from r2bspec.judge.verdict_wording import level_sentence, share_sentence
from r2bspec.measure.samples import LOSS_SENSITIVE_FAMILIES
from r2bspec.measure.times import Seconds


def judge_percentile(question: Question) -> Answer:
    """Decide a requirement on a percentile; its metric has a quantile."""
    quantile = question.info.quantile
    if quantile is None:
        raise ValueError(f"{question.info.name} is no percentile")
    pieces, lost = _values_by_iteration(question)
    ranked = RankedMessages(pieces, question.design(allowed_share(quantile)))
    if not ranked.n:
        return Answer(outcome="inconclusive", method="none", reason="There is no message to judge.")
    interval = percentile_interval(ranked, quantile, question.confidence)
    share = _share_test(question, ranked, lost, quantile)
    towards, against = (
        (interval.upper, interval.lower)
        if question.is_upper_bound
        else (interval.lower, interval.upper)
    )
    outcome = decide(passes=question.is_met(towards), fails=not question.is_met(against))
    reason, remedy = percentile_texts(question, share, interval, outcome)
    return Answer(
        outcome=outcome,
        method="exact binomial",
        reason=reason,
        remedy=remedy,
        notes=percentile_notes(question, interval, outcome),
        estimate=interval.estimate,
        lower=interval.lower,
        upper=interval.upper,
        n=share.n,
        effective_n=share.effective_n,
        over=share.over,
        bursts=share.bursts,
        share=share,
    )


def percentile_texts(
    question: Question,
    test: ShareTest,
    interval: PercentileInterval,
    outcome: Outcome,
    things: str = "messages",
) -> tuple[str, str]:
    """The reason of a decision by an interval, and what would settle an open one.

    Args:
        question: that was decided.
        test: the binomial test of the same messages.
        interval: the bounds, in the metric's unit.
        outcome: by these bounds.
        things: what was counted, in the plural.
    """
    levels = interval.levels
    counts_decide = test.upper <= test.allowed or test.lower > test.allowed
    if outcome != "inconclusive" or levels is None or not counts_decide:
        remedy = share_remedy(question, test, things)
        return (
            share_sentence(question, test, outcome),
            remedy if outcome == "inconclusive" else "",
        )
    return (
        level_sentence(question, interval, levels),
        levels_remedy(question, interval, levels),
    )


def percentile_notes(
    question: Question, interval: PercentileInterval, outcome: Outcome
) -> tuple[str, ...]:
    """What a decided percentile cannot know."""
    notes, levels = share_notes(question, outcome), interval.levels
    if levels is None or outcome == "inconclusive":
        return notes
    return (*notes, *correlation_notes(levels.pieces, levels.number, levels.inflation))


def _values_by_iteration(question: Question) -> tuple[list[Seconds], int]:
    """The messages of each iteration, in order, and how many are lost (infinitely off)."""
    family = question.info.family
    if question.info.scope == "playback":
        return [one.playback.lateness for one in question.iterations], 0
    seen = [one.monitors[question.monitor or ""] for one in question.iterations]
    lost = sum(one.missed for one in seen) if family in LOSS_SENSITIVE_FAMILIES else 0
    worst = math.inf if question.is_upper_bound else -math.inf
    return [one.in_order(family, worst) for one in seen], lost


def _share_test(
    question: Question, ranked: RankedMessages, lost: int, quantile: float
) -> ShareTest:
    """How many messages are on the wrong side of the limit, and how many may be.

    A lower limit (> L) fails on the messages at or below it: the test of an upper one, negated.
    """
    # '<' and '>=' share one boundary, '<=' and '>' the other.
    side = "left" if question.requirement.op in {"<", ">="} else "right"
    within = int(np.searchsorted(ranked.ordered, question.limit, side=side))  # type: ignore[call-overload]
    n, above = ranked.n, ranked.n - within
    sample = ranked.effective_sample(above, largest=question.is_upper_bound)
    counts = above / sample.inflation, n / sample.inflation
    lower = lower_bound(*counts, question.confidence)
    upper = upper_bound(*counts, question.confidence)
    if question.is_upper_bound:
        allowed = allowed_share(quantile)
        tolerance = burst_tolerance(above, n, allowed, question.confidence)
    else:
        lower, upper = 1 - upper, 1 - lower
        allowed, tolerance = quantile, None
    return ShareTest(
        n=n,
        effective_n=sample.messages,
        over=sample.bad,
        bursts=sample.bursts,
        clustering=sample.cause,
        lost=lost,
        share=sample.bad / n,
        lower=lower,
        upper=upper,
        allowed=allowed,
        burst_tolerance=tolerance,
    )


DECIDER = Decider(
    takes=lambda question: question.info.statistic == "percentile" and not question.is_equality,
    decide=lambda question, _: judge_percentile(question),
)
