"""What host interference does to a verdict on pairs: only a difference between the sides counts.

Interference makes a single run doubtful. Interference that base and head had alike is no difference
between them, and where it was not quite alike by chance, the test on the pairs has accounted for
that: it made the pairs differ. So a verdict on pairs is opened only where more was taken from one
side than from the other, and where that can explain it.

Of each run the record has the share w of the time that others can have taken from it
(`r2bspec.judge.waiting_bound`; where that is unknown, `r2bspec.judge.best_case`). A run that needs
more of the processor waits longer under the same load, and this is its own affair. So in pair i,
with the processor time u per time that the runs used themselves, the excess of the head is

    e_i = w_head - w_base max(1, u_head / u_base)

and that of the base likewise. A side has an excess if the lower bound of Student's t on the mean
e_i over all pairs is above 0 at 99 % confidence; otherwise the sides had it alike. (At 95 % the
load would seem uneven in one of seven comparisons with new pairs, though it was not.) A disturbance
of some pairs that is too uneven to show as an excess makes the ratios of those pairs as uneven, and
their t is no larger.

    verdict   stays if                                        otherwise
    FAIL      the unaffected pairs fail, too                  INCONCLUSIVE
              or the head has no excess
              or all pairs fail without the head's excess
    PASS      the unaffected pairs pass, too                  INCONCLUSIVE
              or the base has no excess
              or all pairs pass without the base's excess

*Without the excess*: an affected iteration of that side is given its best case, as if others had
taken max(0, e_i) of the time from it and nothing besides; the other side is as it was played. No
verdict becomes a PASS or a FAIL, so the errors are at most those of the pairs as they were played.

Under ``strict`` a PASS also needs an unaffected pair in place of each, and that these pass. Under
``tolerate`` nothing is examined.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import msgspec

from r2bspec.judge.affected_iterations import find_affected_iterations, largest_taken_share
from r2bspec.judge.best_case import best_case_iteration
from r2bspec.judge.interference_policy import REMEDY
from r2bspec.judge.judge_requirement import iterations_at
from r2bspec.judge.statistics.t_interval import mean_interval
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.measure.samples import RunSamples, SegmentSamples
from r2bspec.measure.units import show
from r2bspec.record.comparison_folder import Side

EXCESS_CONFIDENCE: Final = 0.99
"""At which one side had more interference than the other."""


@dataclass(frozen=True)
class InterleavedRuns:
    """Some pairs, each a run of the base and one of the head, and the head's runs as one."""

    base: Sequence[RunSamples]
    head: Sequence[RunSamples]
    merged: RunSamples

    def of(self, side: Side) -> Sequence[RunSamples]:
        """The runs of one side, in the order of the pairs."""
        return self.base if side == "base" else self.head


@dataclass(frozen=True)
class TakenShares:
    """The mean share of the time that others can have taken from either side at a rate.

    Attributes:
        excess: the lower bound of the mean excess of the side that was asked about; 0 or less if
            the sides had it alike.
    """

    base: float
    head: float
    excess: float

    @property
    def text(self) -> str:
        """Both shares, as a part of a sentence."""
        return (
            f"{show(self.head, 'share')} of the time from the head, "
            f"{show(self.base, 'share')} from the base"
        )


def taken_shares(
    pairs: InterleavedRuns, side: Side, at_hz: float | None, confidence: float = EXCESS_CONFIDENCE
) -> TakenShares:
    """What others can have taken from both sides, and whether `side` has an excess."""
    base, head = ([_taken(run, at_hz) for run in pairs.of(name)] for name in ("base", "head"))
    excesses = [
        pair_excess(one, other, at_hz)
        for one, other in zip(pairs.of(side), pairs.of(_other(side)), strict=True)
    ]
    excess = mean_interval(excesses, confidence).lower if len(excesses) > 1 else 0.0
    number = max(1, len(excesses))
    return TakenShares(math.fsum(base) / number, math.fsum(head) / number, excess)


def pair_excess(one: RunSamples, other: RunSamples, at_hz: float | None) -> float:
    """The share taken from `one` beyond what the load that `other` met would have taken from it."""
    own, others = _own_cores(one, at_hz), _own_cores(other, at_hz)
    longer = max(1.0, own / others) if own and others else 1.0
    return _taken(one, at_hz) - longer * _taken(other, at_hz)


def without_excess(pairs: InterleavedRuns, side: Side) -> InterleavedRuns:
    """The pairs with the affected iterations of one side as if it had met what the other met."""
    runs = [
        _without_excess(one, other)
        for one, other in zip(pairs.of(side), pairs.of(_other(side)), strict=True)
    ]
    return replace(pairs, base=runs) if side == "base" else replace(pairs, head=runs)


def examined_failure(
    judged: RequirementVerdict,
    unaffected: RequirementVerdict,
    without: RequirementVerdict,
    taken: TakenShares,
    disturbance_text: str,
) -> RequirementVerdict:
    """A FAIL of pairs, some of which were affected by host interference.

    Args:
        judged: the verdict on all pairs as they were played.
        unaffected: that on the unaffected ones.
        without: that on all pairs without the head's excess.
        taken: from both sides, with the excess of the head.
        disturbance_text: which pairs were affected, as a sentence without its full stop.
    """
    if unaffected.outcome == "fail":
        return _noted(judged, f"{disturbance_text}. The unaffected pairs fail, too.")
    if taken.excess <= 0:
        return _noted(
            judged,
            f"{disturbance_text}. Base and head had it alike ({taken.text}), so that it does not "
            "explain the difference.",
        )
    # A latency of which nothing is left without the excess has no ratio: it is explained.
    is_explained = without.estimate is None and judged.estimate is not None
    if without.outcome == "fail" and not is_explained:
        return _noted(
            judged,
            f"{disturbance_text}. The head had more of it ({taken.text}). That does not explain "
            "the failure: it fails without the excess, too.",
        )
    return _opened(
        judged,
        f"{disturbance_text}. The head had more of it ({taken.text}). Without the excess the "
        "requirement might be met, so it does not count as failed.",
    )


def examined_pass(
    judged: RequirementVerdict,
    unaffected: RequirementVerdict,
    without: RequirementVerdict,
    taken: TakenShares,
    disturbance_text: str,
) -> RequirementVerdict:
    """A PASS of such pairs; `without` is that without the excess of the base, which `taken` has."""
    if "pass" in (unaffected.outcome, without.outcome) or taken.excess <= 0:
        return judged
    return _opened(
        judged,
        f"{disturbance_text}. The base had more of it ({taken.text}). Without the excess the "
        "requirement might not be met, so it does not count as passed.",
    )


def _without_excess(one: RunSamples, other: RunSamples) -> RunSamples:
    affected = find_affected_iterations(one)
    return replace(
        one,
        iterations={
            rate: tuple(
                best_case_iteration(each, max(0.0, pair_excess(one, other, rate)))
                if each.segment.id in affected
                else each
                for each in played
            )
            for rate, played in one.iterations.items()
        },
    )


def _taken(run: RunSamples, at_hz: float | None) -> float:
    """The share of the time that others can have taken from a run at a rate, in the mean."""
    return _mean([largest_taken_share(each.interference) for each in _played(run, at_hz)])


def _own_cores(run: RunSamples, at_hz: float | None) -> float:
    """The processor time per time that a run used at a rate; 0 if it is not known."""
    return _mean(
        [
            (each.interference.own_cores if each.interference else None) or 0.0
            for each in _played(run, at_hz)
        ]
    )


def _played(run: RunSamples, at_hz: float | None) -> Sequence[SegmentSamples]:
    return iterations_at(run.iterations, at_hz)


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values) if values else 0.0


def _other(side: Side) -> Side:
    return "head" if side == "base" else "base"


def _noted(judged: RequirementVerdict, note: str) -> RequirementVerdict:
    return msgspec.structs.replace(judged, notes=(*judged.notes, note))


def _opened(judged: RequirementVerdict, note: str) -> RequirementVerdict:
    return msgspec.structs.replace(
        _noted(judged, note), outcome="inconclusive", remedy=REMEDY, weakened=True
    )
