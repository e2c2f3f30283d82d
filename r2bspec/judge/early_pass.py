"""Whether a PASS may end a run before its declared starts.

A run that ends early has met less, and a PASS is wrong where the rest would have shown it. S starts
do not rule out a further kind of start that makes up u = 1 - 0.05^(1/S) of all
(`statistics.rule_of_three`): 45 % with 5 starts, 26 % with 10. So a PASS ends a run only if the
requirement would still be met though those starts are worse by a fifth, and if the same counts
show it though bad messages come in bursts of 20 (which inflate the variance by 2 x 20 - 1). The
largest share u* of those starts that it has room for, with the limit L:

    mean          L / v = 1 + u* / 5, with the bound v; for a lower limit L / v = 1 - u* / 5
    percentile    (1 - u*) P(x > L) + u* P(x > L / 1.2) is what is allowed
    drop rate     the bound + u* / 5 is what is allowed

All else waits for the declared starts, such as windows. A FAIL waits for nothing: what was met is
enough. Of pairs, each is a start of either side, and the limit is that of the ratio.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from r2bspec.judge.measure.samples import starts_of
from r2bspec.judge.measure.times import Seconds
from r2bspec.judge.measure.units import show
from r2bspec.judge.requirement_case import RequirementCase
from r2bspec.judge.statistics.binomial import upper_bound
from r2bspec.judge.statistics.percentile_interval import allowed_share
from r2bspec.judge.statistics.rule_of_three import zero_failure_bound
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.language.benchmark_defaults import CONFIDENCE

_WORSE_BY: Final = 0.2
_BURSTS_EFFECT: Final = 39.0


def early_doubt(case: RequirementCase, passed: RequirementVerdict) -> str:
    """Return why a PASS does not end a run before its declared starts; empty if it does.

    Args:
        case: with iterations.
        passed: by a test.
    """
    test, starts = passed.share, len(set(starts_of(case.iterations)))
    if test is not None and not holds_in_bursts(test.over, test.n, test.allowed, passed.confidence):
        return _few_text(f"{starts} starts", test.n)
    return _doubt(starts, "starts", _room(case, passed))


def early_doubt_of_pairs(case: RequirementCase, passed: RequirementVerdict, messages: int) -> str:
    """Return the same for a ratio.

    Args:
        case: of the ratio.
        passed: by as many pairs as it counts.
        messages: of the head, behind its values.
    """
    quantile = case.info.quantile
    if quantile is not None:
        allowed = allowed_share(max(quantile, 1 - quantile))
        if not holds_in_bursts(0, messages, allowed, passed.confidence):
            return _few_text(f"{passed.n} pairs", messages)
    return _doubt(passed.n, "pairs", _room_of_bound(case, passed))


def holds_in_bursts(over: int, n: int, allowed: float, confidence: float) -> bool:
    """Return whether counts show a share though what is over comes in bursts of 20."""
    return upper_bound(over / _BURSTS_EFFECT, n / _BURSTS_EFFECT, confidence) <= allowed


def _few_text(what: str, counted: int) -> str:
    return (
        f"{what} have {show(counted, 'count')} of what is counted, too few to end early if what is "
        "beyond the limit comes in bursts of 20."
    )


def _doubt(number: int, pieces: str, room: float) -> str:
    unmet = zero_failure_bound(number, CONFIDENCE)
    if unmet <= room:
        return ""
    return (
        f"{number} {pieces} do not rule out a kind of start that makes up "
        f"{show(unmet, 'share', 2)} of all; if it is a fifth worse, it might break the limit."
    )


def _room(case: RequirementCase, passed: RequirementVerdict) -> float:
    """Return u* of a PASS; below any share where there is no rule."""
    test = passed.share
    if test is None:
        return _room_of_bound(case, passed)
    if case.in_windows:
        return -math.inf
    if case.info.quantile is None:
        return room_of_losses(test.upper, test.allowed)
    if not case.is_upper_bound:
        return -math.inf
    return room_of_percentile(case.values_by_iteration()[0], case.limit, test.allowed)


def _room_of_bound(case: RequirementCase, passed: RequirementVerdict) -> float:
    bound = passed.upper if case.is_upper_bound else passed.lower
    if bound is None or case.info.statistic not in {"mean", "percentile", "search"}:
        return -math.inf
    return room_of_mean(bound, case.limit, upper=case.is_upper_bound)


def room_of_mean(bound: float, limit: float, *, upper: bool) -> float:
    """Return u* of a mean.

    Args:
        bound: by the starts that were met.
        limit: in the same unit.
        upper: whether both are upper bounds.
    """
    if bound <= 0:
        return math.inf if upper else -math.inf
    return (limit / bound - 1) / (_WORSE_BY if upper else -_WORSE_BY)


def room_of_percentile(values: Sequence[Seconds], limit: float, allowed: float) -> float:
    """Return u* of a percentile.

    Args:
        values: of each iteration, at least one in all.
        limit: in their unit.
        allowed: the share of messages that may be over it.
    """
    messages = np.concatenate(values)
    over, nearly = (float(np.mean(messages > at)) for at in (limit, limit / (1 + _WORSE_BY)))
    return (allowed - over) / (nearly - over) if nearly > over else math.inf


def room_of_losses(bound: float, allowed: float) -> float:
    """Return u* of a share of lost outputs, from its upper bound."""
    return (allowed - bound) / _WORSE_BY
