"""What a run may have missed by chance, and whether that would change a verdict.

A verdict is wrong if the graph does more than the run has shown. Three such cases cannot be tested,
because nothing in the run shows them:

Another kind of start
    S starts do not rule out a further kind that makes up u = 1 - 0.05^(1/S) of all: 63 % with
    three, 45 % with five, 26 % with ten; nor do a few starts show that each resembles the one
    before. So a verdict has *room* if it would be the same though such starts are worse (of a FAIL:
    better) by a fifth, with the limit L on that side:

        mean          the bound v of the mean, v (1 + u / 5) <= L, or v (1 - u / 5) >= L
        percentile    the same, and (1 - u) P(x > L) + u P(x > L / 1.2) is at most what is
                      allowed, or (1 - u) P(x > L) + u P(x > L / 0.8) is at least that
        drop rate     the upper bound + u / 5 is at most what is allowed, or the lower one (1 - u)
                      is at least that

Bursts
    Bad messages that come in bursts of 20 inflate the variance of their number by 2 x 20 - 1. A
    verdict on counts has room if a thirty-ninth of the same messages shows it.

A heavy tail
    A mean of which the slowest 1 % of the messages make up a twentieth or more depends on messages
    of which a run meets few. With ten times as many of them it might break its limit.

A run ends before its declared starts only with room for both of the first two
(`early_doubt`): then looking often makes no more verdicts wrong
(`tests/simulation/test_simulation_looks.py`). At its end a verdict counts without room, and says
what it has no room for (`untested`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from r2bspec.judge.measure.times import Seconds
from r2bspec.judge.measure.units import show
from r2bspec.judge.requirement_case import RequirementCase
from r2bspec.judge.statistics.binomial import lower_bound, upper_bound
from r2bspec.judge.statistics.percentile_interval import allowed_share
from r2bspec.judge.statistics.rule_of_three import zero_failure_bound
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.language.benchmark_defaults import CONFIDENCE

FAIL_FROM_STARTS: Final = 5
"""A run that ends before its declared starts, such as by its time budget, fails without room only
with so many starts: three have too often not met both speeds of a graph that has two."""

_BY: Final = 0.2
"""By how much another kind of start is worse or better."""

_BURST: Final = 20
_BURSTS_EFFECT: Final = 2 * _BURST - 1
_TAIL: Final = 0.01
_MAX_TAIL_SHARE: Final = 0.05
_MORE_OF_TAIL: Final = 10.0
_FAR: Final = 2.0
"""Stalls are not likely to move a percentile by more than this factor."""


def early_doubt(case: RequirementCase, verdict: RequirementVerdict) -> str:
    """Return why a verdict does not end a run before its declared starts; empty if it does.

    Args:
        case: with its iterations.
        verdict: a PASS or a FAIL by a test.
    """
    test, starts = verdict.share, len(set(case.starts))
    if test is not None and not decided_in_bursts(
        test.over, test.n, test.allowed, verdict.confidence, below=_few_are_over(case, verdict)
    ):
        return (
            f"{starts} starts have {show(test.n, 'count')} of what is counted, too few to end "
            f"early if what is beyond the limit comes in bursts of {_BURST}."
        )
    return other_starts(starts, _room(case, verdict), verdict)


def untested(case: RequirementCase, verdict: RequirementVerdict) -> str:
    """Return what would change a verdict but cannot show in the run; empty if nothing would.

    Args:
        case: with all iterations.
        verdict: a PASS or a FAIL by a test.
    """
    starts = len(set(case.starts))
    texts = [_burst_text(case, verdict), _tail_text(case, verdict)]
    is_passed_share = case.info.statistic == "share" and verdict.outcome == "pass"
    if starts > 1 and not is_passed_share:
        texts.append(other_starts(starts, _room(case, verdict), verdict))
    return next(filter(None, texts), "")


def decided_in_bursts(over: int, n: int, allowed: float, confidence: float, *, below: bool) -> bool:
    """Return True if counts decide about a share even if the bad messages come in bursts.

    Args:
        over: bad messages.
        n: all messages.
        allowed: the share that is tested.
        confidence: the confidence of the bound.
        below: whether the share is to be shown to be at most that, and not to be more.
    """
    counts = over / _BURSTS_EFFECT, n / _BURSTS_EFFECT, confidence
    return upper_bound(*counts) <= allowed if below else lower_bound(*counts) > allowed


def other_starts(number: int, room: float, verdict: RequirementVerdict) -> str:
    """Return that another kind of start would change a verdict; empty if there is room for it.

    Args:
        number: the number of starts.
        room: the largest share of another kind.
        verdict: a PASS or a FAIL.
    """
    unmet = zero_failure_bound(number, CONFIDENCE)
    if unmet <= room:
        return ""
    worse, would = ("are a fifth worse", "break")
    if verdict.outcome != "pass":
        worse, would = ("are a fifth better", "meet")
    if verdict.metric.endswith("drop_rate"):
        worse = "lose a fifth" if verdict.outcome == "pass" else "lose nothing"
    return (
        f"{number} starts do not rule out another kind of start, up to "
        f"{show(unmet, 'share', 2)} of all, or that each start resembles the previous start: "
        f"starts that {worse} would {would} the limit."
    )


def _is_below(case: RequirementCase, verdict: RequirementVerdict) -> bool:
    """Return whether the verdict says that the true value is below the limit."""
    return (verdict.outcome == "pass") == case.is_upper_bound


def _few_are_over(case: RequirementCase, verdict: RequirementVerdict) -> bool:
    """Return whether the verdict says that few of what is counted are bad."""
    of_losses = case.info.quantile is None
    return (verdict.outcome == "pass") == (case.is_upper_bound or not of_losses)


def _room(case: RequirementCase, verdict: RequirementVerdict) -> float:
    """Return the room of a verdict; below any share where there is no rule."""
    test, below = verdict.share, _is_below(case, verdict)
    if test is None:
        return _room_of_bound(case, verdict, below=below)
    quantile = case.info.quantile
    if quantile is None:
        return room_of_losses(test.upper if below else test.lower, test.allowed, below=below)
    pieces, _ = case.values_by_iteration()
    room = room_of_percentile(pieces, case.limit, allowed_share(quantile), below=below)
    return min(room, _room_of_bound(case, verdict, below=below))


def _room_of_bound(case: RequirementCase, verdict: RequirementVerdict, *, below: bool) -> float:
    bound = verdict.upper if below else verdict.lower
    if bound is None or case.info.statistic not in {"mean", "percentile", "search"}:
        return -math.inf
    return room_of_mean(bound, case.limit, below=below)


def room_of_mean(bound: float, limit: float, *, below: bool) -> float:
    """Return the distance of a mean from its limit.

    Args:
        bound: the bound of the starts that were met, on the side of the limit.
        limit: in the same unit.
        below: whether the mean is below the limit.
    """
    if bound <= 0:
        return math.inf if below else -math.inf
    return (limit / bound - 1) / (_BY if below else -_BY)


def room_of_percentile(
    values: Sequence[Seconds], limit: float, allowed: float, *, below: bool
) -> float:
    """Return the distance of a percentile from its limit.

    Args:
        values: of each iteration, at least one in all.
        limit: in their unit.
        allowed: the share of messages that may be over it.
        below: whether the percentile is below the limit.
    """
    messages = np.concatenate([*values])
    changed = limit / (1 + _BY if below else 1 - _BY)
    over, moved = (float(np.mean(messages > at)) for at in (limit, changed))
    # Both differences have the sign of the change.
    return (allowed - over) / (moved - over) if moved != over else math.inf


def room_of_losses(bound: float, allowed: float, *, below: bool) -> float:
    """Return the distance of the bound on a share of lost outputs from the limit."""
    if below:
        return (allowed - bound) / _BY
    return 1 - allowed / bound if bound > 0 else -math.inf


def _burst_text(case: RequirementCase, verdict: RequirementVerdict) -> str:
    """Return how many bad messages in a row would break the limit of a PASS on counts."""
    test = verdict.share
    if test is None or verdict.outcome != "pass" or not case.is_upper_bound:
        return ""
    if decided_in_bursts(test.over, test.n, test.allowed, verdict.confidence, below=True):
        return ""
    of_losses = case.info.quantile is None
    estimate = verdict.estimate or 0.0
    if not of_losses and (estimate <= 0 or case.limit > _FAR * estimate):
        return ""
    more = math.floor(test.allowed * test.n) - test.over + 1
    what = "were lost" if of_losses else f"were over {case.limit_text}"
    met = show(test.over, "count") if test.over else "None"
    return (
        f"{met} of {show(test.n, 'count')} {what}; a burst of {show(more, 'count')} "
        f"{'more ' if test.over else ''}in a row would break the limit, and a run of this length "
        "may meet none."
    )


def _tail_text(case: RequirementCase, verdict: RequirementVerdict) -> str:
    """Return that a small mean rests on few messages."""
    of_messages = case.info.statistic == "mean" and case.info.metric.lost_is_slowest
    if not of_messages or verdict.outcome != "pass" or not case.is_upper_bound:
        return ""
    messages = np.sort(np.concatenate(case.message_values))
    slowest = math.fsum(messages[messages.size - math.ceil(_TAIL * messages.size) :])
    share = slowest / math.fsum(messages)
    if share <= _MAX_TAIL_SHARE or case.limit > (verdict.estimate or 0) * (
        1 + _MORE_OF_TAIL * share
    ):
        return ""
    return (
        f"The slowest {show(_TAIL, 'share')} of the messages make up {show(share, 'share', 2)} of "
        "the mean, and a run meets few of them: require a percentile."
    )
