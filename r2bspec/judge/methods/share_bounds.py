"""How percentiles and shares are decided, and in which words.

Shares
------

The counts of all iterations are tested, with their design effect
(`r2bspec.judge.statistics.shares`). Nothing but the counts shows that starts differ, so that the
bound by which a share passes has a level of its own.

Percentiles
-----------

``latency.p99 < L`` says that at most 1 % of all messages take L or longer. The messages of all
iterations are pooled. A lost message counts as on the wrong side of the limit: otherwise a graph
that drops its slowest messages would improve its percentiles.

The bounds are also at least as far from the percentile as iterations and starts differ
(`r2bspec.judge.statistics.percentile_interval`). Where only that leaves the verdict open, it says
so.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np

from r2bspec.judge.measure.units import show
from r2bspec.judge.requirement_case import Decision, RequirementCase, undecided
from r2bspec.judge.statistics.more_pieces import (
    Decides,
    advice,
    mean_decides,
    more_pieces,
    share_decides,
)
from r2bspec.judge.statistics.percentile_interval import (
    LevelMargin,
    PercentileInterval,
    RankedMessages,
    allowed_share,
    percentile_interval,
)
from r2bspec.judge.statistics.shares import ShareBounds, ShareLimit, bounds_of_flags
from r2bspec.judge.statistics.t_interval import scatter_level
from r2bspec.judge.verdict import Outcome, ShareTest
from r2bspec.record.run_record import RunRecord

_ONE_ITERATION: Final = "One iteration does not show by how much iterations differ."


def judge_share(case: RequirementCase, _: RunRecord) -> Decision:
    """Decide a requirement on ``drop_rate``: the share of missed outputs."""
    missed = [np.logical_not(around.came) for around in case.monitor_samples]
    # No margin of levels protects this share: its upper bound has a level of its own.
    careful = scatter_level(case.confidence, of_shares=True)
    bounds = bounds_of_flags(missed, case.starts, _tested(case, case.limit), careful)
    if not bounds.n:
        return undecided("No step was played.")
    test = share_test(bounds, case.limit, lost=bounds.bad)
    outcome = case.outcome_of_bounds(test.lower, test.upper)
    return _decision(
        case,
        test,
        outcome,
        remedy=_remedy(case, test) if outcome == "inconclusive" else "",
        estimate=test.share,
        lower=test.lower,
        upper=test.upper,
    )


def _tested(case: RequirementCase, allowed: float) -> ShareLimit:
    return ShareLimit(allowed, case.confidence, case.level)


def _decision(case: RequirementCase, test: ShareTest, outcome: Outcome, **details: Any) -> Decision:
    """Return the decision of a binomial test; `details` are further fields of it."""
    is_single = outcome != "inconclusive" and len(case.iterations) == 1
    fields: dict[str, Any] = {"reason": share_sentence(case, test, outcome)} | details
    return Decision(
        outcome=outcome,
        method="exact binomial",
        n=test.n,
        effective_n=test.effective_n,
        over=test.over,
        share=test,
        notes=(_ONE_ITERATION,) if is_single else (),
        **fields,
    )


def share_test(bounds: ShareBounds, allowed: float, *, lost: int = 0) -> ShareTest:
    """Return the test of a share as a verdict has it.

    Args:
        bounds: on the share.
        allowed: the share that is allowed or required.
        lost: how many of the bad messages never arrived.
    """
    return ShareTest(
        n=bounds.n,
        effective_n=bounds.n / bounds.effect,
        over=bounds.bad,
        differ=bounds.differ,
        lost=lost,
        share=bounds.bad / bounds.n,
        lower=bounds.lower,
        upper=bounds.upper,
        allowed=allowed,
    )


def judge_percentile(case: RequirementCase, _: RunRecord) -> Decision:
    """Decide a requirement on a percentile; its metric has a quantile."""
    quantile = case.info.quantile
    if quantile is None:
        raise ValueError(f"{case.info.name} is no percentile")
    pieces, lost = case.values_by_iteration()
    if not any(piece.size for piece in pieces):
        return undecided("There is no message to judge.")
    ranked = RankedMessages(pieces, case.starts, _tested(case, allowed_share(quantile)))
    test = _share_test(case, ranked, lost, quantile)
    interval = percentile_interval(ranked, quantile)
    outcome = case.outcome_of_bounds(interval.lower, interval.upper)
    details: dict[str, Any] = {}
    if outcome == "inconclusive":
        if interval.levels is not None and counts_decide(test):
            details["reason"] = level_sentence(case, interval, interval.levels)
        details["remedy"] = _remedy(case, test, interval)
    return _decision(
        case,
        test,
        outcome,
        estimate=interval.estimate,
        lower=interval.lower,
        upper=interval.upper,
        **details,
    )


def _remedy(
    case: RequirementCase, test: ShareTest, interval: PercentileInterval | None = None
) -> str:
    """Return what would decide a test that its counts or the levels leave open.

    Args:
        case: that is undecided.
        test: the test of the counts.
        interval: the interval of the percentile, where it is one.
    """
    if test.allowed <= 0:
        return (
            "No number of messages can prove that none is ever lost. Require an observed count "
            "(missed == 0), or allow a small share."
        )
    number, pieces = case.pieces
    needed: list[Decides] = []
    if not counts_decide(test):
        counts = test.share * test.effective_n, test.effective_n
        needed.append(share_decides(*counts, test.allowed, number, case.confidence))
    levels = interval.levels if interval is not None else None
    if interval is not None and levels is not None:
        distance = abs(interval.estimate - case.limit)
        would_pass = (case.limit > interval.estimate) == case.is_upper_bound
        half = levels.tail if would_pass else levels.half
        if distance <= half and number > 1:
            needed.append(mean_decides(distance, half, number, case.level))
    more = more_pieces(number, *needed)
    if more is not None:
        return advice(more, pieces)
    if levels is not None and counts_decide(test):
        return (
            f"The percentile is too close to {case.limit_text} for {levels.pieces} that differ "
            f"by {show(levels.deviation, case.info.unit)}: change the limit, or use a quieter "
            "machine."
        )
    return (
        f"The observed share ({show(test.share, 'share')}) is too close to the allowed share "
        f"({show(test.allowed, 'share')}) for a longer run to decide. Change the limit or the "
        "graph."
    )


def _share_test(
    case: RequirementCase, ranked: RankedMessages, lost: int, quantile: float
) -> ShareTest:
    """Return how many messages are on the wrong side of the limit, and how many may be.

    A lower limit (> L) fails on the messages at or below it: the test of an upper limit, negated.
    """
    # '<' and '>=' share one boundary, '<=' and '>' the other.
    strict, ordered = case.requirement.op in {"<", ">="}, ranked.ordered
    over = int(np.count_nonzero(ordered >= case.limit if strict else ordered > case.limit))
    bounds = replace(ranked.over(over), bad=over)
    if case.is_upper_bound:
        return share_test(bounds, allowed_share(quantile), lost=lost)
    turned = replace(bounds, bad=bounds.n - over, lower=1 - bounds.upper, upper=1 - bounds.lower)
    return share_test(turned, quantile, lost=lost)


# Words.

_MIN_EFFECTIVE_SHARE = 0.95
_MIN_WHOLE_COUNT = 10


def share_sentence(case: RequirementCase, test: ShareTest, outcome: Outcome) -> str:
    """Return how many are on the wrong side of the limit, what that shows, and what is allowed."""
    seen = (
        f"{show(test.over, 'count')} of {show(test.n, 'count')} {case.info.metric.noun} "
        f"({_percent(test.share)}) {_wrong_side(case, test)}{_effective_size_text(test)}"
    )
    sure = f"at {case.confidence_text}"
    lower, upper = _percent(test.lower), _percent(test.upper)
    allowed = show(test.allowed, "share", 6)
    # A lower bound on a share (drop_rate > x) needs many; every other requirement allows a few.
    needs_many = case.info.quantile is None and not case.is_upper_bound
    needed = f"and more than {allowed} is required" if needs_many else f"and {allowed} is allowed"
    if outcome == "inconclusive":
        return f"{seen}; {sure} the true share is {lower} to {upper}, {needed}."
    if (outcome == "pass") != needs_many:
        return f"{seen}; {sure} the true share is at most {upper}, {needed}."
    return f"{seen}; {sure} the true share is at least {lower}, {needed}."


def level_sentence(case: RequirementCase, interval: PercentileInterval, levels: LevelMargin) -> str:
    """Return that iterations or starts differ too much for a percentile to be decided."""
    unit = case.info.unit
    return (
        f"{case.info.name} is {show(interval.estimate, unit)}, but the {levels.number} "
        f"{levels.pieces} differ by {show(levels.deviation, unit)} (standard deviation); at "
        f"{case.confidence_text} it is {show(interval.lower, unit)} to "
        f"{show(interval.upper, unit)}, which includes the limit {case.limit_text}."
    )


def _effective_size_text(test: ShareTest) -> str:
    """Return the effective sample size, where starts, iterations or stretches differ."""
    n = test.effective_n
    if n > _MIN_EFFECTIVE_SHARE * test.n:
        return ""
    size = show(n, "count") if n >= _MIN_WHOLE_COUNT else show(n, "", 2)
    return (
        f", judged by the scatter of the {test.differ} (effective sample size {size} of "
        f"{show(test.n, 'count')})"
    )


def _wrong_side(case: RequirementCase, test: ShareTest) -> str:
    if case.info.statistic == "share":
        return "got no output"
    side = "over" if case.is_upper_bound else "under"
    lost = f", including {show(test.lost, 'count')} lost" if test.lost else ""
    return f"are {side} {case.limit_text}{lost}"


def _percent(share: float) -> str:
    """Return a share with two digits; a share below 1 is never written as 100 %."""
    text = show(share, "share", 2)
    return text if text != "100 %" or share == 1 else show(min(share, 0.999), "share")


def counts_decide(test: ShareTest) -> bool:
    """Return True if the counts alone decide."""
    return test.upper <= test.allowed or test.lower > test.allowed
