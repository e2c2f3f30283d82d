"""Whether a verdict has room for what the starts of a run have not met.

A test tells what follows from what a run has met, and S starts do not rule out a further kind of
start that makes up u = 1 - 0.05^(1/S) of all (`statistics.rule_of_three`): 63 % with 3 starts, 45 %
with 5, 14 % with 20. A PASS has room for it if the requirement would still be met though those
starts are worse by a fifth. The largest share u* of them that it has room for, with the limit L:

    mean          L / v = 1 + u* / 5, with the bound v; for a lower limit L / v = 1 - u* / 5
    percentile    (1 - u*) P(x > L) + u* P(x > L / 1.2) is what is allowed
    drop rate     the bound + u* / 5 is what is allowed

Before the declared starts
--------------------------

A run that ends early has met less, and a PASS is wrong where the rest would have shown it: of
graphs of which every fifth start is slow, three starts miss the slow ones in 51 % of runs, and five
in 33 %. So a PASS ends a run before its declared starts only if u <= u*, and if the same counts
show the requirement though bad messages come in bursts of 20 on average (`burst_tolerance`). All
else waits for the declared starts, such as windows. A FAIL waits for nothing: what was met is
enough. Of pairs, each is a start of either side, and the limit is that of the ratio: of a head of
which every fifth start is slow, 21 % pass wrongly where looks end ten pairs, and 10 % with this
rule, as without looks (docs/proofs/verdicts.md).

At the end
----------

Of a latency that would not be met with the kind of start that S starts miss in one run of five,
u = 1 - 0.2^(1/S) of all, a verdict says so, and how many starts would have met it. (With 0.05, as
before, no more wrong verdicts would say something, and twice as many right ones.) A PASS or a
FAIL that is closer to its limit than hours on one machine are to each other says that, too: of a
latency by 7 %; of lost outputs by a factor of eight, because where few are lost, a graph that is
slower by 7 % loses several times as many. Both are said of narrow verdicts alone. What a
graph delivers is bounded by what is offered: of this nothing is said.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from r2bspec.judge.caveats import LONG_BURST
from r2bspec.judge.measure.samples import LOSS_SENSITIVE_FAMILIES, starts_of
from r2bspec.judge.measure.times import Seconds
from r2bspec.judge.measure.units import show
from r2bspec.judge.requirement_case import RequirementCase
from r2bspec.judge.statistics.binomial import burst_tolerance
from r2bspec.judge.statistics.percentile_interval import allowed_share
from r2bspec.judge.statistics.rule_of_three import min_sample_size, zero_failure_bound
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.language.benchmark_defaults import CONFIDENCE

_WORSE_BY: Final = 0.2

_NOTED_CONFIDENCE: Final = 0.8

_HOURS_DIFFER_BY: Final = 0.07
"""Two and a half standard deviations of simulated hours (docs/proofs/verdicts.md)."""

_HOURS_LOSE_BY: Final = 8.0
"""Times as many: what 7 % make of a share of 1 % where messages scatter by 10 %: with the normal
distribution P(x > 2.33) is eight times P(x > 2.33 + 0.7)."""

_MIGHT_BREAK: Final = "One that is a fifth worse might break the limit."

_MAX_PROPOSED: Final = 100
"""More starts than this are not proposed."""


def room_of_mean(bound: float, limit: float, *, upper: bool) -> float:
    """u* of a mean.

    Args:
        bound: by the starts that were met.
        limit: in the same unit.
        upper: whether both are upper ones.
    """
    if bound <= 0:
        return math.inf if upper else -math.inf
    return (limit / bound - 1) / (_WORSE_BY if upper else -_WORSE_BY)


def room_of_percentile(values: Sequence[Seconds], limit: float, allowed: float) -> float:
    """u* of a percentile.

    Args:
        values: of each iteration, at least one in all.
        limit: in their unit.
        allowed: the share of messages that may be over it.
    """
    messages = np.concatenate(values)
    over, nearly = (float(np.mean(messages > at)) for at in (limit, limit / (1 + _WORSE_BY)))
    return (allowed - over) / (nearly - over) if nearly > over else math.inf


def room_of_losses(bound: float, allowed: float) -> float:
    """u* of a share of lost outputs, from its upper bound."""
    return (allowed - bound) / _WORSE_BY


def early_doubt(case: RequirementCase, passed: RequirementVerdict) -> str:
    """Why a PASS does not end a run before its declared starts; empty if it does.

    Args:
        case: with iterations.
        passed: by a test.
    """
    test, starts = passed.share, _starts(case)
    if test is not None and not (test.burst_tolerance or 0) >= LONG_BURST:
        return _burst_text(f"{starts} starts", test.n)
    if zero_failure_bound(starts, CONFIDENCE) <= _room(case, passed):
        return ""
    return f"{_unmet_text(starts, 'starts')} {_MIGHT_BREAK}"


def early_doubt_of_pairs(case: RequirementCase, passed: RequirementVerdict, messages: int) -> str:
    """The same of a ratio by pairs.

    Args:
        case: of the ratio.
        passed: by as many pairs as it counts.
        messages: of the head, behind its values.
    """
    pairs, statistic, quantile = passed.n, case.info.statistic, case.info.quantile
    if quantile is not None:
        allowed = allowed_share(max(quantile, 1 - quantile))
        tolerance = burst_tolerance(0, messages, allowed, passed.confidence)
        if (tolerance or 0) < LONG_BURST:
            return _burst_text(f"{pairs} pairs", messages)
    bound = passed.upper if case.is_upper_bound else passed.lower
    has_rule = quantile is not None or statistic == "mean" or case.info.scope == "search"
    if has_rule and bound is not None:
        room = room_of_mean(bound, case.limit, upper=case.is_upper_bound)
        if zero_failure_bound(pairs, CONFIDENCE) <= room:
            return ""
    return f"{_unmet_text(pairs, 'pairs')} {_MIGHT_BREAK}"


def narrow_margin_notes(case: RequirementCase, verdict: RequirementVerdict) -> tuple[str, ...]:
    """That a decision on a latency or on losses is too close to its limit for what was not met.

    Args:
        case: with the iterations on which it was decided.
        verdict: the last one on it.
    """
    decided = verdict.outcome != "inconclusive" and not verdict.early
    if not (decided and case.is_upper_bound and not case.in_windows):
        return ()
    if case.info.statistic == "share":
        return _narrow_losses(verdict)
    nearest = verdict.upper if verdict.outcome == "pass" else verdict.lower
    of_latency = case.info.family in LOSS_SENSITIVE_FAMILIES
    if not (of_latency and case.info.statistic in {"mean", "percentile"} and nearest):
        return ()
    passed, margin = verdict.outcome == "pass", abs(case.limit / nearest - 1)
    by = f"by at least {show(margin, 'share', 2)}"
    starts, room = _starts(case), _room(case, verdict) if passed else math.inf
    unmet = zero_failure_bound(starts, _NOTED_CONFIDENCE)
    if starts > 1 and room < unmet:
        number = min_sample_size(room, _NOTED_CONFIDENCE)
        more = f" {number} starts would have room." if number and number <= _MAX_PROPOSED else ""
        text = (
            f"{starts} starts miss a kind of start that makes up {show(unmet, 'share', 2)} of all "
            "in one run of five. One that is a fifth slower would break the limit, which is met"
        )
        return (f"{text} {by}.{more}",)
    if margin >= _HOURS_DIFFER_BY:
        return ()
    met, other = ("met", "slower") if passed else ("missed", "faster")
    return (f"It is {met} {by}, and another hour on this machine may be {other} by as much.",)


def _narrow_losses(verdict: RequirementVerdict) -> tuple[str, ...]:
    test = verdict.share
    if test is None or not test.over or not test.allowed:
        return ()
    passed = verdict.outcome == "pass"
    factor = test.allowed / test.share if passed else test.share / test.allowed
    if factor >= _HOURS_LOSE_BY:
        return ()
    met, others = ("met", "eight times") if passed else ("missed", "an eighth")
    by = f"by a factor of {factor:.2g}"
    return (f"It is {met} {by}, and at another hour {others} as many outputs may be lost.",)


def _starts(case: RequirementCase) -> int:
    return len(set(starts_of(case.iterations)))


def _unmet_text(number: int, pieces: str) -> str:
    return (
        f"{number} {pieces} do not rule out a kind of start that makes up "
        f"{show(zero_failure_bound(number, CONFIDENCE), 'share', 2)} of all."
    )


def _burst_text(what: str, counted: int) -> str:
    return (
        f"{what} have {show(counted, 'count')} of what is counted, too few to pass if what is "
        f"beyond the limit comes in bursts of {LONG_BURST:g}."
    )


def _room(case: RequirementCase, passed: RequirementVerdict) -> float:
    """u* of a PASS; below any share where there is no rule."""
    test, no_rule = passed.share, -math.inf
    if test is not None and not case.in_windows and case.info.quantile is None:
        return room_of_losses(test.upper, test.allowed)
    if test is not None:
        if case.in_windows or not case.is_upper_bound:
            return no_rule
        return room_of_percentile(case.values_by_iteration()[0], case.limit, test.allowed)
    bound = passed.upper if case.is_upper_bound else passed.lower
    if bound is None:
        return no_rule
    return room_of_mean(bound, case.limit, upper=case.is_upper_bound)
