"""Bounds on percentiles and shares, by the exact binomial test on single messages.

Shares
------

The counts of all iterations are tested.

Percentiles
-----------

``latency.p99 < L`` says that at most 1 % of all messages take L or longer. The messages of all
iterations are pooled, with their effective sample size
(`r2bspec.judge.statistics.effective_sample_size`). A lost message counts as on the wrong side of
the limit: otherwise a graph that drops its slowest messages would improve its percentiles.

The bounds are also at least as far from the percentile as iterations and starts differ
(`r2bspec.judge.statistics.percentile_interval`). Where only that leaves the verdict open, it says
so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from r2bspec.judge.caveats import correlation_notes, share_notes
from r2bspec.judge.measure.samples import LOSS_SENSITIVE_FAMILIES, MonitorSamples, starts_of
from r2bspec.judge.measure.times import Seconds
from r2bspec.judge.methods import Method
from r2bspec.judge.methods.share_wording import (
    level_sentence,
    levels_remedy,
    share_remedy,
    share_sentence,
)
from r2bspec.judge.requirement_case import (
    Decision,
    DecisionMethod,
    RequirementCase,
    undecided,
)
from r2bspec.judge.statistics.autocorrelation import serial_inflation
from r2bspec.judge.statistics.binomial import burst_tolerance, lower_bound, upper_bound
from r2bspec.judge.statistics.effective_sample_size import EffectiveSample, effective_sample
from r2bspec.judge.statistics.percentile_interval import (
    PercentileInterval,
    RankedMessages,
    allowed_share,
    percentile_interval,
)
from r2bspec.judge.verdict import Outcome, ShareTest


def judge_share(case: RequirementCase) -> Decision:
    """Decide a requirement on ``drop_rate``: missed outputs, of the expected ones."""
    seen = case.monitor_samples
    sample = effective_sample(
        [np.logical_not(one.steps.answered) for one in seen], case.design(case.limit)
    )
    if not sample.n:
        return undecided("No step was played.")
    test = share_test(
        sample, case.limit, case.confidence, lost=sample.bad, ceiling=case.is_upper_bound
    )
    outcome = case.outcome_of_bounds(test.lower, test.upper)
    return decision_by_share(
        test,
        outcome,
        reason=share_sentence(case, test, outcome),
        remedy=share_remedy(case, test) if outcome == "inconclusive" else "",
        notes=_notes(case, seen, outcome),
        estimate=test.share,
        lower=test.lower,
        upper=test.upper,
    )


def decision_by_share(
    test: ShareTest, outcome: Outcome, *, method: Method = "exact binomial", **details: Any
) -> Decision:
    """The decision that a binomial test makes; `details` are further fields of it."""
    return Decision(
        outcome=outcome,
        method=method,
        n=test.n,
        effective_n=test.effective_n,
        over=test.over,
        bursts=test.bursts,
        share=test,
        **details,
    )


def _notes(
    case: RequirementCase, seen: Sequence[MonitorSamples], outcome: Outcome
) -> tuple[str, ...]:
    """What the decision cannot know, such as how much successive starts resemble each other."""
    notes, starts = share_notes(case, outcome), starts_of(case.iterations)
    if outcome == "inconclusive":
        return notes
    several = len(set(starts)) > 1
    numbers = np.array(starts if several else range(len(seen)))
    missed = np.bincount(numbers, [one.missed for one in seen])
    expected = np.bincount(numbers, [one.expected for one in seen])
    shares = (missed[expected > 0] / expected[expected > 0]).tolist()
    pieces = "starts" if several else "iterations"
    return (*notes, *correlation_notes(pieces, len(shares), serial_inflation(shares)))


def share_test(
    sample: EffectiveSample,
    allowed: float,
    confidence: float,
    *,
    lost: int = 0,
    ceiling: bool = True,
) -> ShareTest:
    """The binomial test on counts whose effective sample size is known.

    Args:
        sample: the counts.
        allowed: the share that is allowed, or, where `ceiling` is False, required.
        confidence: of each bound by itself.
        lost: how many of the bad ones never arrived.
        ceiling: whether the share must be small.
    """
    return ShareTest(
        n=sample.n,
        effective_n=sample.messages,
        over=sample.bad,
        bursts=sample.bursts,
        clustering=sample.cause,
        lost=lost,
        share=sample.bad / sample.n,
        lower=lower_bound(sample.bad_messages, sample.messages, confidence),
        upper=upper_bound(sample.bad_messages, sample.messages, confidence),
        allowed=allowed,
        burst_tolerance=burst_tolerance(sample.bad, sample.n, allowed, confidence)
        if ceiling
        else None,
    )


SHARE_BOUND = DecisionMethod(
    takes=lambda case: case.info.statistic == "share" and not case.is_equality,
    decide=lambda case, _: judge_share(case),
)


def judge_percentile(case: RequirementCase) -> Decision:
    """Decide a requirement on a percentile; its metric has a quantile."""
    quantile = case.info.quantile
    if quantile is None:
        raise ValueError(f"{case.info.name} is no percentile")
    pieces, lost = _values_by_iteration(case)
    ranked = RankedMessages(pieces, case.design(allowed_share(quantile)))
    if not ranked.n:
        return undecided("There is no message to judge.")
    interval = percentile_interval(ranked, quantile, case.confidence)
    test = _share_test(case, ranked, lost, quantile)
    return percentile_decision(
        case, test, interval, case.outcome_of_bounds(interval.lower, interval.upper)
    )


def percentile_decision(
    case: RequirementCase,
    test: ShareTest,
    interval: PercentileInterval,
    outcome: Outcome,
    *,
    method: Method = "exact binomial",
    things: str = "messages",
) -> Decision:
    """A decision by an interval, and what would settle an open one.

    Args:
        case: that is decided.
        test: the binomial test of the same messages.
        interval: the bounds, in the metric's unit.
        outcome: by these bounds.
        method: of the decision.
        things: what was counted, in the plural.
    """
    levels, notes = interval.levels, share_notes(case, outcome)
    counts_decide = test.upper <= test.allowed or test.lower > test.allowed
    reason, remedy = share_sentence(case, test, outcome), ""
    if outcome != "inconclusive":
        if levels is not None:
            notes += correlation_notes(levels.pieces, levels.number, levels.inflation)
    elif levels is not None and counts_decide:
        reason = level_sentence(case, interval, levels)
        remedy = levels_remedy(case, interval, levels)
    else:
        remedy = share_remedy(case, test, things)
    return decision_by_share(
        test,
        outcome,
        method=method,
        reason=reason,
        remedy=remedy,
        notes=notes,
        estimate=interval.estimate,
        lower=interval.lower,
        upper=interval.upper,
    )


def _values_by_iteration(case: RequirementCase) -> tuple[list[Seconds], int]:
    """The messages of each iteration, in order, and how many are lost (infinitely off)."""
    family = case.info.family
    if case.info.scope == "playback":
        return [one.playback.lateness for one in case.iterations], 0
    seen = case.monitor_samples
    lost = sum(one.missed for one in seen) if family in LOSS_SENSITIVE_FAMILIES else 0
    worst = math.inf if case.is_upper_bound else -math.inf
    return [one.in_order(family, worst) for one in seen], lost


def _share_test(
    case: RequirementCase, ranked: RankedMessages, lost: int, quantile: float
) -> ShareTest:
    """How many messages are on the wrong side of the limit, and how many may be.

    A lower limit (> L) fails on the messages at or below it: the test of an upper one, negated.
    """
    # '<' and '>=' share one boundary, '<=' and '>' the other.
    side = "left" if case.requirement.op in {"<", ">="} else "right"
    within = int(np.searchsorted(ranked.ordered, case.limit, side=side))  # type: ignore[call-overload]
    above = ranked.n - within
    sample = ranked.effective_sample(above, largest=case.is_upper_bound)
    if case.is_upper_bound:
        return share_test(sample, allowed_share(quantile), case.confidence, lost=lost)
    test = share_test(sample, quantile, case.confidence, lost=lost, ceiling=False)
    counts = above / sample.inflation, sample.messages, case.confidence
    return msgspec.structs.replace(
        test, lower=1 - upper_bound(*counts), upper=1 - lower_bound(*counts)
    )


PERCENTILE_BOUND = DecisionMethod(
    takes=lambda case: case.info.statistic == "percentile" and not case.is_equality,
    decide=lambda case, _: judge_percentile(case),
)
