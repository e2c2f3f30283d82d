"""Whether a PASS may end a run before all its declared starts were played.

A test tells what follows from what a run has met. A run that ends early has met less, and a PASS is
wrong where the rest would have shown it: of graphs of which every fifth start is slow, three starts
miss the slow ones in 51 % of runs, and five in 33 %. So before the declared starts, a PASS ends a
run only if it has room for what these few cannot have met:

    bursts    The same counts show the requirement if bad messages come in bursts of 20 on average
              (`burst_tolerance`).
    starts    With a further kind of start, as frequent as S starts without one of it can rule out,
              u = 1 - 0.05^(1/S) (`statistics.rule_of_three`), and worse by a fifth, the
              requirement would still be met:

                  mean          v (1 + u / 5) for an upper limit, v (1 - u / 5) for a lower one,
                                with the bound v
                  percentile    (1 - u) P(x > L) + u P(x > L / 1.2) is at most what is allowed
                  drop rate     the bound + u / 5

Of 3 starts u is 63 %, of 5 it is 45 %, of 20 it is 14 %. All else waits for the declared starts,
such as windows. A FAIL waits for nothing: what was met is enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from r2bspec.judge.caveats import LONG_BURST
from r2bspec.judge.measure.samples import starts_of
from r2bspec.judge.measure.times import Seconds
from r2bspec.judge.measure.units import show
from r2bspec.judge.methods.share_bounds import values_by_iteration
from r2bspec.judge.requirement_case import Decision, RequirementCase
from r2bspec.judge.statistics.rule_of_three import zero_failure_bound
from r2bspec.language.benchmark_defaults import CONFIDENCE

_WORSE_BY: Final = 0.2


def bound_with_unmet(bound: float, starts: int, *, upper: bool) -> float:
    """The bound on a mean with a further kind of start.

    Args:
        bound: by the starts that were met.
        starts: their number.
        upper: whether it is an upper bound.
    """
    worse = _WORSE_BY * zero_failure_bound(starts, CONFIDENCE)
    return bound * (1 + worse if upper else 1 - worse)


def share_with_unmet(values: Sequence[Seconds], limit: float, starts: int) -> float:
    """The share of messages over a limit with a further kind of start.

    Args:
        values: of each iteration, at least one in all.
        limit: in their unit.
        starts: the number that was met.
    """
    unmet = zero_failure_bound(starts, CONFIDENCE)
    ordered = np.concatenate(values)
    over, nearly = (np.mean(ordered > at) for at in (limit, limit / (1 + _WORSE_BY)))
    return float((1 - unmet) * over + unmet * nearly)


def losses_with_unmet(bound: float, starts: int) -> float:
    """The upper bound on a share of lost outputs with a further kind of start."""
    return bound + _WORSE_BY * zero_failure_bound(starts, CONFIDENCE)


def early_doubt(case: RequirementCase, decision: Decision) -> str:
    """Why a PASS does not end a run before its declared starts; empty if it does.

    Args:
        case: with iterations.
        decision: that it passes, by a test.
    """
    starts, test = len(set(starts_of(case.iterations))), decision.share
    if test is not None and not (test.burst_tolerance or 0) >= LONG_BURST:
        return (
            f"{starts} starts have {show(test.n, 'count')} of what is counted, too few to pass "
            f"if what is beyond the limit comes in bursts of {LONG_BURST:g}."
        )
    if case.windows is None and _has_room(case, decision, starts):
        return ""
    return (
        f"{starts} starts do not rule out a kind of start that makes up "
        f"{show(zero_failure_bound(starts, CONFIDENCE), 'share', 2)} of all. One that is a fifth "
        "worse might break the limit."
    )


def _has_room(case: RequirementCase, decision: Decision, starts: int) -> bool:
    """The rules on starts of the module's text."""
    quantile, test = case.info.quantile, decision.share
    if quantile is not None and test is not None:
        values, _ = values_by_iteration(case)
        return case.is_upper_bound and (
            share_with_unmet(values, case.limit, starts) <= test.allowed
        )
    if test is not None:
        return losses_with_unmet(test.upper, starts) <= test.allowed
    bound = decision.upper if case.is_upper_bound else decision.lower
    return bound is not None and case.is_met(
        bound_with_unmet(bound, starts, upper=case.is_upper_bound)
    )
