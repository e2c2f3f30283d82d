"""``latency.p99 < 50 ms in 99 % of 1 s windows``: the exact binomial test over windows.

Each complete window of each iteration (`r2bspec.judge.measure.metric_values`) has a value of the
metric, and either meets the bound or does not. At most a share 1 - SHARE of all windows may not.
That is a bound on a percentile of the windows' values, and is judged as one: with the effective
number of windows, for bad windows come in bursts as bad messages do. For a lower limit the values
are negated.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from r2bspec.judge.caveats import share_notes
from r2bspec.judge.measure.metric_values import WindowValues, has_windows, window_values
from r2bspec.judge.measure.samples import LOSS_SENSITIVE_FAMILIES
from r2bspec.judge.measure.times import Seconds
from r2bspec.judge.measure.units import show
from r2bspec.judge.methods.mean_bound import MAX_LOST_SHARE
from r2bspec.judge.methods.message_share import (
    decision_by_share,
    percentile_decision,
    share_test,
)
from r2bspec.judge.methods.share_wording import counted_noun, share_remedy, share_sentence
from r2bspec.judge.requirement_case import (
    Decision,
    DecisionMethod,
    RequirementCase,
    WindowCondition,
    decide,
    undecided,
)
from r2bspec.judge.statistics.effective_sample_size import (
    BadFlags,
    effective_sample,
)
from r2bspec.judge.statistics.percentile_interval import (
    RankedMessages,
    allowed_share,
    percentile_interval,
)


def judge_windows(case: RequirementCase) -> Decision:
    """Decide a requirement that must be met in a share of windows, which it names."""
    windows = case.windows
    if windows is None:
        raise ValueError(f"{case.requirement.text} names no windows")
    if not has_windows(case.info):
        return Decision(
            outcome="fail",
            method="none",
            reason=f"{case.info.name} is a metric of a run, not of a window.",
        )
    worst = math.inf if case.is_upper_bound else -math.inf
    found = [
        window_values(case.info, case.monitor or "", one, windows.window_ns, worst)
        for one in case.iterations
    ]
    pieces = [np.array(one.values) for one in found]
    if not any(piece.size for piece in pieces):
        return _without_windows(case, windows, found)
    if case.is_equality:
        return _judge_equality(case, windows, pieces)
    decision = _judge_ordered(case, windows, pieces)
    return _without_lost(case, windows, found, decision)


def _without_lost(
    case: RequirementCase, windows: WindowCondition, found: list[WindowValues], decision: Decision
) -> Decision:
    """The answer with regard to lost outputs, which the mean latency of a window leaves out.

    Windows that lost more than 1 % may be slower than their means: a PASS must allow for that.
    """
    of_latency = case.info.family in LOSS_SENSITIVE_FAMILIES
    if not (of_latency and case.info.statistic == "mean" and case.is_upper_bound):
        return decision
    lossy = [np.array([share > MAX_LOST_SHARE for share in one.lost]) for one in found]
    number = sum(int(np.count_nonzero(flags)) for flags in lossy)
    if decision.outcome != "pass" or not number:
        return decision
    counted = [
        np.where(flags, math.inf, one.values) if flags.size else np.array(one.values)
        for one, flags in zip(found, lossy, strict=True)
    ]
    total = sum(len(one.values) for one in found)
    left_out = (
        f"{show(number, 'count')} of {show(total, 'count')} {counted_noun(case)} lost more "
        f"than {show(MAX_LOST_SHARE, 'share')} of their outputs, which a mean leaves out"
    )
    if _judge_ordered(case, windows, counted).outcome == "pass":
        note = f"{left_out}. If they do not count as met, the requirement passes, too."
        return replace(decision, notes=(*decision.notes, note))
    return replace(
        decision,
        outcome="inconclusive",
        reason=f"{left_out}, and without them {decision.reason[:1].lower()}{decision.reason[1:]}",
        remedy="State a percentile, in which lost outputs count, or a drop_rate.",
        notes=(),
    )


def _without_windows(
    case: RequirementCase, windows: WindowCondition, found: list[WindowValues]
) -> Decision:
    length = show(windows.window_ns / 1e9, "s")
    if any(one.without for one in found):
        reason = f"A window of {length} has too few messages for {case.info.name}."
    else:
        reason = f"No iteration is as long as a window of {length}."
    return undecided(reason, "Use longer windows, or make the iterations longer.")


def _judge_ordered(
    case: RequirementCase, windows: WindowCondition, pieces: list[Seconds]
) -> Decision:
    """The test with its bounds in the metric's unit."""
    sign = 1.0 if case.is_upper_bound else -1.0
    ranked = RankedMessages(
        [sign * piece for piece in pieces], case.design(allowed_share(windows.share))
    )
    interval = percentile_interval(ranked, windows.share, case.confidence)
    lower, upper = sorted((sign * interval.lower, sign * interval.upper))
    bad = sum(int(np.count_nonzero(flags)) for flags in _bad(case, pieces))
    return percentile_decision(
        case,
        share_test(ranked.effective_sample(bad), allowed_share(windows.share), case.confidence),
        replace(interval, estimate=sign * interval.estimate, lower=lower, upper=upper),
        case.outcome_of_bounds(lower, upper),
        method="binomial over windows",
        things=counted_noun(case),
    )


def _judge_equality(
    case: RequirementCase, windows: WindowCondition, pieces: list[Seconds]
) -> Decision:
    """The test alone: with == and != the windows' values have no order that matters."""
    allowed = allowed_share(windows.share)
    sample = effective_sample(_bad(case, pieces), case.design(allowed))
    test = share_test(sample, allowed, case.confidence)
    outcome = decide(passes=test.upper <= test.allowed, fails=test.lower > test.allowed)
    things = counted_noun(case)
    return decision_by_share(
        test,
        outcome,
        method="binomial over windows",
        reason=share_sentence(case, test, outcome),
        remedy=share_remedy(case, test, things) if outcome == "inconclusive" else "",
        notes=share_notes(case, outcome),
    )


def _bad(case: RequirementCase, pieces: list[Seconds]) -> list[BadFlags]:
    return [
        np.array([not case.is_met(value) for value in piece], dtype=np.bool_) for piece in pieces
    ]


WINDOW_SHARE = DecisionMethod(
    takes=lambda case: case.windows is not None,
    decide=lambda case, _: judge_windows(case),
)
