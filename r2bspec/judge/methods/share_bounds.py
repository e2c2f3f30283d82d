"""Bounds on percentiles and shares, by the exact binomial test on single messages or on windows.

Shares
------

The counts of all iterations are tested.

Percentiles
-----------

``latency.p99 < L`` says that at most 1 % of all messages take L or longer. The messages of all
iterations are pooled, with their effective sample size
(`r2bspec.judge.statistics.design_effect`). A lost message counts as on the wrong side of
the limit: otherwise a graph that drops its slowest messages would improve its percentiles.

The bounds are also at least as far from the percentile as iterations and starts differ
(`r2bspec.judge.statistics.percentile_interval`). Where only that leaves the verdict open, it says
so.

Windows
-------

``latency.p99 < 50 ms in 99 % of 1 s windows``: each complete window of each iteration
(`r2bspec.judge.measure.metric_values`) has a value of the metric, and either meets the bound or
does not. At most a share 1 - SHARE of all windows may not. That is a bound on a percentile of the
windows' values, and is judged as such, with the effective number of windows. For a lower limit the
values are negated.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

import msgspec
import numpy as np

from r2bspec.judge.measure.metric_values import WindowValues, has_windows, window_values
from r2bspec.judge.measure.times import Seconds
from r2bspec.judge.measure.units import show
from r2bspec.judge.methods import Method
from r2bspec.judge.methods.share_wording import (
    counted_noun,
    counts_decide,
    level_sentence,
    share_sentence,
)
from r2bspec.judge.requirement_case import (
    MAX_LOST_SHARE,
    Decision,
    RequirementCase,
    decide,
    undecided,
)
from r2bspec.judge.statistics.binomial import lower_bound, upper_bound
from r2bspec.judge.statistics.design_effect import BadFlags, EffectiveSample, effective_sample
from r2bspec.judge.statistics.more_pieces import (
    Decides,
    advice,
    mean_decides,
    more_pieces,
    share_decides,
)
from r2bspec.judge.statistics.percentile_interval import (
    PercentileInterval,
    RankedMessages,
    allowed_share,
    percentile_interval,
)
from r2bspec.judge.verdict import Outcome, ShareTest
from r2bspec.record.run_record import RunRecord

_ONE_ITERATION: Final = "One iteration does not show by how much iterations differ."


def judge_share(case: RequirementCase, _: RunRecord) -> Decision:
    """Decide a requirement on ``drop_rate``: missed outputs, of the expected ones."""
    missed = [np.logical_not(around.came) for around in case.monitor_samples]
    sample = effective_sample(missed, case.design(case.limit))
    if not sample.n:
        return undecided("No step was played.")
    test = share_test(sample, case.limit, case.confidence, lost=sample.bad)
    outcome = case.outcome_of_bounds(test.lower, test.upper)
    return decision_by_share(
        test,
        outcome,
        reason=share_sentence(case, test, outcome),
        remedy=_remedy(case, test) if outcome == "inconclusive" else "",
        notes=_notes(case, outcome),
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
        share=test,
        **details,
    )


def _notes(case: RequirementCase, outcome: Outcome) -> tuple[str, ...]:
    """Return that a percentile or a share was decided by a single iteration."""
    decided = outcome != "inconclusive"
    return (_ONE_ITERATION,) if decided and len(case.iterations) == 1 else ()


def share_test(
    sample: EffectiveSample, allowed: float, confidence: float, *, lost: int = 0
) -> ShareTest:
    """Return the binomial test on counts whose effective sample size is known.

    Args:
        sample: the counts.
        allowed: the share that is allowed or required.
        confidence: of each bound by itself.
        lost: how many of the bad messages never arrived.
    """
    return ShareTest(
        n=sample.n,
        effective_n=sample.messages,
        over=sample.bad,
        differ=sample.differ,
        lost=lost,
        share=sample.bad / sample.n,
        lower=lower_bound(sample.bad_messages, sample.messages, confidence),
        upper=upper_bound(sample.bad_messages, sample.messages, confidence),
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
    ranked = RankedMessages(pieces, case.design(allowed_share(quantile)))
    test = _share_test(case, ranked, lost, quantile)
    return percentile_decision(case, test, percentile_interval(ranked, quantile))


def percentile_decision(
    case: RequirementCase,
    test: ShareTest,
    interval: PercentileInterval,
    *,
    method: Method = "exact binomial",
) -> Decision:
    """Return a decision by an interval, and what would settle an open requirement.

    Args:
        case: that is decided.
        test: the binomial test of the same messages.
        interval: the bounds, in the metric's unit.
        method: of the decision.
    """
    outcome = case.outcome_of_bounds(interval.lower, interval.upper)
    reason, remedy = share_sentence(case, test, outcome), ""
    if outcome == "inconclusive":
        if interval.levels is not None and counts_decide(test):
            reason = level_sentence(case, interval, interval.levels)
        remedy = _remedy(case, test, interval)
    return decision_by_share(
        test,
        outcome,
        method=method,
        reason=reason,
        remedy=remedy,
        notes=_notes(case, outcome),
        estimate=interval.estimate,
        lower=interval.lower,
        upper=interval.upper,
    )


def _remedy(
    case: RequirementCase, test: ShareTest, interval: PercentileInterval | None = None
) -> str:
    """Return what would decide a test that its counts or the levels leave open.

    Args:
        case: that is undecided.
        test: of the counts.
        interval: of the percentile, where it is one.
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
            needed.append(mean_decides(distance, half, number, case.confidence))
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
    sample = ranked.sample(over)
    if case.is_upper_bound:
        return share_test(sample, allowed_share(quantile), case.confidence, lost=lost)
    under = replace(sample, bad=sample.n - over)
    test = share_test(under, quantile, case.confidence, lost=lost)
    counts = sample.bad_messages, sample.messages, case.confidence
    return msgspec.structs.replace(
        test, lower=1 - upper_bound(*counts), upper=1 - lower_bound(*counts)
    )


def judge_windows(case: RequirementCase, _: RunRecord) -> Decision:
    """Decide a requirement that must be met in a share of windows, which it names."""
    share, window_ns = case.requirement.windows_share, case.requirement.window_ns
    if share is None:
        raise ValueError(f"{case.requirement.text} names no windows")
    if not has_windows(case.info):
        return Decision(
            outcome="fail",
            method="none",
            reason=f"{case.info.name} is a metric of a run, not of a window.",
        )
    worst = math.inf if case.is_upper_bound else -math.inf
    observed = [
        window_values(case.info, case.monitor or "", iteration, window_ns, worst)
        for iteration in case.iterations
    ]
    pieces = [np.array(one.values) for one in observed]
    if not any(piece.size for piece in pieces):
        return _without_windows(case, observed)
    if case.is_equality:
        return _judge_equality(case, share, pieces)
    decision = _judge_ordered(case, share, pieces)
    return _without_lost(case, share, observed, decision)


def _without_lost(
    case: RequirementCase,
    share: float,
    found: list[WindowValues],
    decision: Decision,
) -> Decision:
    """The answer with regard to lost outputs, which the mean latency of a window leaves out.

    Windows that lost more than 1 % may be slower than their means: a PASS must allow for that.
    """
    info = case.info
    if not (info.metric.lost_is_slowest and info.statistic == "mean" and case.is_upper_bound):
        return decision
    lossy = [np.array([lost > MAX_LOST_SHARE for lost in observed.lost]) for observed in found]
    number = sum(int(np.count_nonzero(flags)) for flags in lossy)
    if decision.outcome != "pass" or not number:
        return decision
    counted = [
        np.where(flags, math.inf, observed.values) if flags.size else np.array(observed.values)
        for observed, flags in zip(found, lossy, strict=True)
    ]
    total = sum(len(observed.values) for observed in found)
    left_out = (
        f"{show(number, 'count')} of {show(total, 'count')} {counted_noun(case)} lost more "
        f"than {show(MAX_LOST_SHARE, 'share')} of their outputs, which a mean leaves out"
    )
    if _judge_ordered(case, share, counted).outcome == "pass":
        note = f"{left_out}. If they do not count as met, the requirement passes, too."
        return replace(decision, notes=(*decision.notes, note))
    return replace(
        decision,
        outcome="inconclusive",
        reason=f"{left_out}, and without them {decision.reason[:1].lower()}{decision.reason[1:]}",
        remedy="State a percentile, in which lost outputs count, or a drop_rate.",
        notes=(),
    )


def _without_windows(case: RequirementCase, found: list[WindowValues]) -> Decision:
    length = show(case.requirement.window_ns / 1e9, "s")
    if any(observed.without for observed in found):
        reason = f"A window of {length} has too few messages for {case.info.name}."
    else:
        reason = f"No iteration is as long as a window of {length}."
    return undecided(reason, "Use longer windows, or make the iterations longer.")


def _judge_ordered(case: RequirementCase, share: float, pieces: list[Seconds]) -> Decision:
    """Decide by the test with its bounds in the metric's unit."""
    sign = 1.0 if case.is_upper_bound else -1.0
    ranked = RankedMessages([sign * piece for piece in pieces], case.design(allowed_share(share)))
    interval = percentile_interval(ranked, share)
    lower, upper = sorted((sign * interval.lower, sign * interval.upper))
    bad = sum(int(np.count_nonzero(flags)) for flags in _bad(case, pieces))
    return percentile_decision(
        case,
        share_test(ranked.sample(bad), allowed_share(share), case.confidence),
        replace(interval, estimate=sign * interval.estimate, lower=lower, upper=upper),
        method="binomial over windows",
    )


def _judge_equality(case: RequirementCase, share: float, pieces: list[Seconds]) -> Decision:
    """Decide by the test alone: with == and != the windows' values have no order that matters."""
    allowed = allowed_share(share)
    test = share_test(
        effective_sample(_bad(case, pieces), case.design(allowed)), allowed, case.confidence
    )
    outcome = decide(passes=test.upper <= test.allowed, fails=test.lower > test.allowed)
    return decision_by_share(
        test,
        outcome,
        method="binomial over windows",
        reason=share_sentence(case, test, outcome),
        remedy=_remedy(case, test) if outcome == "inconclusive" else "",
        notes=_notes(case, outcome),
    )


def _bad(case: RequirementCase, pieces: list[Seconds]) -> list[BadFlags]:
    return [
        np.array([not case.is_met(value) for value in piece], dtype=np.bool_) for piece in pieces
    ]
