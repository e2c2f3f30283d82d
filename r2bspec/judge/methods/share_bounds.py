"""How percentiles, shares and requirements on windows are decided, and in which words.

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

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.metric_values import WindowValues, has_windows, window_values
from r2bspec.judge.measure.times import Seconds
from r2bspec.judge.measure.units import show
from r2bspec.judge.methods import Method
from r2bspec.judge.requirement_case import (
    MAX_LOST_SHARE,
    Decision,
    RequirementCase,
    decide,
    undecided,
)
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
    bounds = _bounds_of_flags(case, missed, case.limit)
    if not bounds.n:
        return undecided("No step was played.")
    test = share_test(bounds, case.limit, lost=bounds.bad)
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


def _bounds_of_flags(
    case: RequirementCase, flags: list[NDArray[np.bool_]], allowed: float
) -> ShareBounds:
    """Return the bounds on a share that no margin of levels protects."""
    careful = scatter_level(case.confidence, of_shares=True)
    return bounds_of_flags(flags, case.starts, _tested(case, allowed), careful)


def _tested(case: RequirementCase, allowed: float) -> ShareLimit:
    return ShareLimit(allowed, case.confidence, case.level)


def decision_by_share(
    test: ShareTest, outcome: Outcome, *, method: Method = "exact binomial", **details: Any
) -> Decision:
    """Return the decision of a binomial test; `details` are further fields of it."""
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
    return percentile_decision(case, test, percentile_interval(ranked, quantile))


def percentile_decision(
    case: RequirementCase,
    test: ShareTest,
    interval: PercentileInterval,
    *,
    method: Method = "exact binomial",
) -> Decision:
    """Return a decision by an interval, with what would settle an open requirement.

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


def judge_windows(case: RequirementCase, _: RunRecord) -> Decision:
    """Decide a requirement that must be met in a stated share of windows."""
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
    """Return the answer with regard to lost outputs, which the mean latency of a window leaves out.

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
    tested = _tested(case, allowed_share(share))
    ranked = RankedMessages([sign * piece for piece in pieces], case.starts, tested)
    interval = percentile_interval(ranked, share)
    lower, upper = sorted((sign * interval.lower, sign * interval.upper))
    bad = sum(int(np.count_nonzero(flags)) for flags in _bad(case, pieces))
    return percentile_decision(
        case,
        share_test(replace(ranked.over(bad), bad=bad), allowed_share(share)),
        replace(interval, estimate=sign * interval.estimate, lower=lower, upper=upper),
        method="binomial over windows",
    )


def _judge_equality(case: RequirementCase, share: float, pieces: list[Seconds]) -> Decision:
    """Decide by the test alone: with == and != the windows' values have no order that matters."""
    allowed = allowed_share(share)
    test = share_test(_bounds_of_flags(case, _bad(case, pieces), allowed), allowed)
    outcome = decide(passes=test.upper <= test.allowed, fails=test.lower > test.allowed)
    return decision_by_share(
        test,
        outcome,
        method="binomial over windows",
        reason=share_sentence(case, test, outcome),
        remedy=_remedy(case, test) if outcome == "inconclusive" else "",
        notes=_notes(case, outcome),
    )


def _bad(case: RequirementCase, pieces: list[Seconds]) -> list[NDArray[np.bool_]]:
    return [
        np.array([not case.is_met(value) for value in piece], dtype=np.bool_) for piece in pieces
    ]


# Words.

_MIN_EFFECTIVE_SHARE = 0.95
_MIN_WHOLE_COUNT = 10


def counted_noun(case: RequirementCase) -> str:
    """Return what is counted for a metric, in the plural."""
    if case.in_windows:
        return f"windows of {show(case.requirement.window_ns / 1e9, 's')}"
    return case.info.metric.noun


def share_sentence(case: RequirementCase, test: ShareTest, outcome: Outcome) -> str:
    """Return how many are on the wrong side of the limit, what that shows, and what is allowed."""
    seen = (
        f"{show(test.over, 'count')} of {show(test.n, 'count')} {counted_noun(case)} "
        f"({_percent(test.share)}) {_wrong_side(case, test)}{_effective_size_text(test)}"
    )
    sure = f"at {case.confidence_text}"
    lower, upper = _percent(test.lower), _percent(test.upper)
    allowed = show(test.allowed, "share", 6)
    # A lower bound on a share (drop_rate > x) needs many; every other requirement allows a few.
    needs_many = not case.in_windows and case.info.quantile is None and not case.is_upper_bound
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
    if case.in_windows:
        return f"do not meet {case.metric_text}"
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
