"""Bounds on percentiles and shares, by the exact binomial test on single messages or on windows.

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

Windows
-------

``latency.p99 < 50 ms in 99 % of 1 s windows``: each complete window of each iteration
(`r2bspec.judge.measure.metric_values`) has a value of the metric, and either meets the bound or
does not. At most a share 1 - SHARE of all windows may not. That is a bound on a percentile of the
windows' values, and is judged as one: with the effective number of windows, for bad windows come in
bursts as bad messages do. For a lower limit the values are negated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from r2bspec.judge.caveats import correlation_notes, share_notes, uneven_start_notes
from r2bspec.judge.measure.metric_values import WindowValues, has_windows, window_values
from r2bspec.judge.measure.samples import LOSS_SENSITIVE_FAMILIES, MonitorSamples, starts_of
from r2bspec.judge.measure.times import Seconds
from r2bspec.judge.measure.units import show
from r2bspec.judge.methods import Method
from r2bspec.judge.methods.share_wording import (
    clustering,
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
from r2bspec.judge.statistics.autocorrelation import serial_degrees_of_freedom, serial_inflation
from r2bspec.judge.statistics.binomial import burst_tolerance, lower_bound, upper_bound
from r2bspec.judge.statistics.effective_sample_size import (
    BadFlags,
    EffectiveSample,
    effective_sample,
)
from r2bspec.judge.statistics.percentile_interval import (
    PercentileInterval,
    RankedMessages,
    allowed_share,
    middle_ends,
    middle_half,
    percentile_interval,
)
from r2bspec.judge.statistics.variance_components import (
    growth_for_mean,
    growth_for_share,
    quantile_scale,
)
from r2bspec.judge.uncertainty_budget import (
    Costs,
    Observations,
    deciding_addition,
    deciding_text,
    resolution,
    uncertainty_budget,
)
from r2bspec.judge.verdict import Outcome, ShareTest
from r2bspec.record.run_record import RunRecord


def judge_share(case: RequirementCase, record: RunRecord) -> Decision:
    """Decide a requirement on ``drop_rate``: missed outputs, of the expected ones."""
    seen = case.monitor_samples
    missed = [np.logical_not(around.steps.answered) for around in seen]
    sample = effective_sample(missed, case.design(case.limit))
    if not sample.n:
        return undecided("No step was played.")
    test = share_test(
        sample, case.limit, case.confidence, lost=sample.bad, ceiling=case.is_upper_bound
    )
    outcome = case.outcome_of_bounds(test.lower, test.upper)
    observed = _observations(case, missed, test)
    return decision_by_share(
        test,
        outcome,
        reason=share_sentence(case, test, outcome),
        remedy=_remedy(case, test, observed, Costs.of(case.iterations, record))
        if outcome == "inconclusive"
        else "",
        notes=_notes(case, seen, outcome),
        estimate=test.share,
        lower=test.lower,
        upper=test.upper,
        budget=uncertainty_budget(
            case, record, observed, (test.share, test.lower, test.upper), 0.0
        ),
    )


def _observations(
    case: RequirementCase, bad: Sequence[BadFlags], test: ShareTest, scale: float = 1.0
) -> Observations:
    """The bad messages of each iteration that has any messages, for the budget."""
    kept = [
        (row, start) for row, start in zip(bad, starts_of(case.iterations), strict=True) if row.size
    ]
    return Observations(
        values=[float(row.mean()) for row, _ in kept],
        starts=[start for _, start in kept],
        rows=[row.astype(np.float64) for row, _ in kept],
        by_level=test.clustering in {"iterations", "starts"},
        scale=scale,
    )


def _percentile_observations(
    case: RequirementCase,
    pieces: Sequence[Seconds],
    interval: PercentileInterval,
    test: ShareTest,
) -> Observations:
    """What the interval of a percentile rests on: levels, or messages beyond the estimate."""
    levels, estimate = interval.levels, interval.estimate
    reach = max(estimate - interval.lower, interval.upper - estimate)
    if levels is None or levels.half < reach:
        scale = quantile_scale(np.sort(np.concatenate(pieces)), estimate)
        return _observations(case, [piece > estimate for piece in pieces], test, scale)
    starts = starts_of(case.iterations)
    kept = [(piece, start) for piece, start in zip(pieces, starts, strict=True) if piece.size]
    # The mean of the middle half scatters like that of the values drawn in to its ends, doubled.
    return Observations(
        values=[middle_half(piece) for piece, _ in kept],
        starts=[start for _, start in kept],
        rows=[2 * np.clip(piece, *middle_ends(piece)) for piece, _ in kept],
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
    # Not the numbers themselves: a record may have any, and as many counts would be made.
    _, numbers = np.unique(starts if several else np.arange(len(seen)), return_inverse=True)
    missed = np.bincount(numbers, [sample.missed for sample in seen])
    expected = np.bincount(numbers, [sample.expected for sample in seen])
    shares = (missed[expected > 0] / expected[expected > 0]).tolist()
    pieces = "starts" if several else "iterations"
    return (
        *notes,
        *uneven_start_notes(case, outcome),
        *correlation_notes(pieces, len(shares), serial_inflation(shares)),
    )


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


def judge_percentile(case: RequirementCase, record: RunRecord) -> Decision:
    """Decide a requirement on a percentile; its metric has a quantile."""
    quantile = case.info.quantile
    if quantile is None:
        raise ValueError(f"{case.info.name} is no percentile")
    pieces, lost = case.values_by_iteration()
    ranked = RankedMessages(pieces, case.design(allowed_share(quantile)))
    if not ranked.n:
        return undecided("There is no message to judge.")
    interval = percentile_interval(ranked, quantile, case.confidence)
    test = _share_test(case, ranked, lost, quantile)
    return percentile_decision(case, record, test, interval, pieces)


def percentile_decision(
    case: RequirementCase,
    record: RunRecord,
    test: ShareTest,
    interval: PercentileInterval,
    pieces: Sequence[Seconds],
    *,
    method: Method = "exact binomial",
    things: str = "messages",
) -> Decision:
    """A decision by an interval, and what would settle an open one.

    Args:
        case: that is decided.
        record: of the run.
        test: the binomial test of the same messages.
        interval: the bounds, in the metric's unit.
        pieces: the messages of each iteration.
        method: of the decision.
        things: what was counted, in the plural.
    """
    outcome = case.outcome_of_bounds(interval.lower, interval.upper)
    levels, notes = interval.levels, share_notes(case, outcome)
    reason, remedy = share_sentence(case, test, outcome), ""
    observed = _percentile_observations(case, pieces, interval, test)
    if outcome == "inconclusive":
        if levels is not None and counts_decide(test):
            reason = level_sentence(case, interval, levels)
        costs = Costs.of(case.iterations, record)
        remedy = _remedy(case, test, observed, costs, interval, things)
    elif levels is not None:
        notes += correlation_notes(levels.pieces, levels.number, levels.inflation)
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
        budget=uncertainty_budget(
            case,
            record,
            observed,
            (interval.estimate, interval.lower, interval.upper),
            resolution(case.info, interval.estimate, 0.0) / math.sqrt(12)
            if case.info.dimension == "time"
            else 0.0,
        ),
    )


def _remedy(
    case: RequirementCase,
    test: ShareTest,
    observed: Observations,
    costs: Costs,
    interval: PercentileInterval | None = None,
    things: str = "messages",
) -> str:
    """What would decide a test that is undecided, by its counts or by levels that differ.

    Args:
        case: that is undecided.
        test: of the counts.
        observed: the same messages by iterations and starts.
        costs: of more of them.
        interval: of the percentile, where it is one.
        things: what was counted, in the plural.
    """
    if test.allowed <= 0:
        return (
            "No number of messages can prove that none is ever lost. Require an observed count "
            "(missed == 0), or allow a small share."
        )
    growth, note, levels = 1.0, "", interval.levels if interval is not None else None
    if not counts_decide(test):
        k, n = test.share * test.effective_n, test.effective_n
        growth = growth_for_share(k, n, test.allowed, case.confidence)
        note = _clustering_note(case, test, things)
    if interval is not None and levels is not None:
        distance = abs(interval.estimate - case.limit)
        would_pass = (case.limit > interval.estimate) == case.is_upper_bound
        half = levels.tail if would_pass else levels.half
        if distance <= half:
            freedom = serial_degrees_of_freedom(levels.number, levels.inflation)
            by_levels = growth_for_mean(distance, half, freedom, case.confidence)
            growth = max(growth, by_levels)
    addition = deciding_addition(observed, growth, case.confidence, costs)
    if addition is not None:
        more = addition.iterations / len(case.iterations)
        more *= addition.number if addition.what == "length" else 1
        counted = f"{show(math.ceil(test.n * more), 'count')} {things}"
        return f"{note}{deciding_text(addition, len(set(observed.starts)), counted)}"
    if levels is not None and counts_decide(test):
        return (
            f"The percentile is too close to {case.limit_text} for {levels.pieces} that differ "
            f"by {show(levels.deviation, case.info.unit)}: change the limit, or use a quieter "
            "machine."
        )
    return (
        f"The observed share ({show(test.share, 'share')}) is too close to the allowed one "
        f"({show(test.allowed, 'share')}) for a longer run to decide. Change the limit or the "
        "graph."
    )


def _clustering_note(case: RequirementCase, test: ShareTest, things: str) -> str:
    """That clustering leaves the test undecided, where it does."""
    counts = test.over, test.n, case.confidence
    if test.effective_n >= test.n:
        return ""
    if upper_bound(*counts) <= test.allowed or lower_bound(*counts) > test.allowed:
        return (
            f"As many independent {things} would have decided it, but those over the limit come "
            f"{clustering(test)}. "
        )
    return ""


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


def judge_windows(case: RequirementCase, record: RunRecord) -> Decision:
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
        return _judge_equality(case, record, share, pieces)
    decision = _judge_ordered(case, record, share, pieces)
    return _without_lost(case, record, share, observed, decision)


def _without_lost(
    case: RequirementCase,
    record: RunRecord,
    share: float,
    found: list[WindowValues],
    decision: Decision,
) -> Decision:
    """The answer with regard to lost outputs, which the mean latency of a window leaves out.

    Windows that lost more than 1 % may be slower than their means: a PASS must allow for that.
    """
    of_latency = case.info.family in LOSS_SENSITIVE_FAMILIES
    if not (of_latency and case.info.statistic == "mean" and case.is_upper_bound):
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
    if _judge_ordered(case, record, share, counted).outcome == "pass":
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


def _judge_ordered(
    case: RequirementCase, record: RunRecord, share: float, pieces: list[Seconds]
) -> Decision:
    """The test with its bounds in the metric's unit."""
    sign = 1.0 if case.is_upper_bound else -1.0
    ranked = RankedMessages([sign * piece for piece in pieces], case.design(allowed_share(share)))
    interval = percentile_interval(ranked, share, case.confidence)
    lower, upper = sorted((sign * interval.lower, sign * interval.upper))
    bad = sum(int(np.count_nonzero(flags)) for flags in _bad(case, pieces))
    return percentile_decision(
        case,
        record,
        share_test(ranked.effective_sample(bad), allowed_share(share), case.confidence),
        replace(interval, estimate=sign * interval.estimate, lower=lower, upper=upper),
        pieces,
        method="binomial over windows",
        things=counted_noun(case),
    )


def _judge_equality(
    case: RequirementCase, record: RunRecord, share: float, pieces: list[Seconds]
) -> Decision:
    """The test alone: with == and != the windows' values have no order that matters."""
    allowed = allowed_share(share)
    bad = _bad(case, pieces)
    sample = effective_sample(bad, case.design(allowed))
    test = share_test(sample, allowed, case.confidence)
    outcome = decide(passes=test.upper <= test.allowed, fails=test.lower > test.allowed)
    remedy = ""
    if outcome == "inconclusive":
        costs = Costs.of(case.iterations, record)
        observed = _observations(case, bad, test)
        remedy = _remedy(case, test, observed, costs, things=counted_noun(case))
    return decision_by_share(
        test,
        outcome,
        method="binomial over windows",
        reason=share_sentence(case, test, outcome),
        remedy=remedy,
        notes=share_notes(case, outcome),
    )


def _bad(case: RequirementCase, pieces: list[Seconds]) -> list[BadFlags]:
    return [
        np.array([not case.is_met(value) for value in piece], dtype=np.bool_) for piece in pieces
    ]
