"""``of baseline``: a requirement on the ratio of a metric to its value before a change.

The values are those of interleaved runs of base and head, in pairs. The limit is the margin, as a
ratio: ``>= 97 % of baseline`` is 0.97. With the one-sided bounds on the true ratio, a lower limit
passes if the lower bound is at or over it and fails if the upper bound is below it; an upper limit
the other way round. A metric without a value in one of the pairs (nothing arrived, a percentile
that falls on a lost message) is not left out: it fails for the head, and decides nothing for the
base. A metric that was not sampled decides nothing for either, and neither does a share of 0, which
has no ratio.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec

from r2bspec.judge.measure.units import show
from r2bspec.judge.methods import Method
from r2bspec.judge.requirement_case import Decision, RequirementCase, finite, requirement_verdict
from r2bspec.judge.statistics.more_pieces import advice, mean_decides, more_pieces
from r2bspec.judge.statistics.t_interval import RatioInterval, paired_ratio
from r2bspec.judge.turn_comparison import ratio_of_starts
from r2bspec.judge.verdict import BaselineEstimate, Outcome, RequirementVerdict

Values = Sequence[float | None]
"""A metric in the iterations of one side; None or infinite where it has no value."""


@dataclass(frozen=True)
class BaselineCase(RequirementCase):
    """A requirement on a ratio; its limit is the ratio that is allowed or required, such as 0.97.

    Attributes:
        resolution: the smallest difference that the clock can show in a value of the metric.
    """

    resolution: float = 0.0

    @property
    def sampled(self) -> bool:
        """Whether a missing value means that nothing was sampled, not that nothing arrived."""
        return self.info.scope.is_sampled


@dataclass(frozen=True)
class _Sides:
    """The values that a ratio is of, and how it is decided."""

    case: BaselineCase
    method: Method
    base: Values
    head: Values

    def undecided(self, reason: str, remedy: str = "") -> RequirementVerdict:
        return self.verdict("inconclusive", reason, remedy)

    def decided(self, interval: RatioInterval, pieces: str, remedy: str) -> RequirementVerdict:
        """The verdict by an interval, with what would settle an open one."""
        outcome = self.case.outcome_of_bounds(interval.lower, interval.upper)
        remedy = remedy if outcome == "inconclusive" else ""
        return self.verdict(outcome, self.reason(interval, pieces), remedy, interval)

    def verdict(
        self, outcome: Outcome, reason: str, remedy: str = "", interval: RatioInterval | None = None
    ) -> RequirementVerdict:
        decision = Decision(
            outcome=outcome,
            method=self.method,
            reason=reason,
            remedy=remedy,
            estimate=interval.ratio if interval is not None else None,
            lower=interval.lower if interval is not None else None,
            upper=interval.upper if interval is not None else None,
            n=interval.n if interval is not None else len(self.base),
        )
        estimate = BaselineEstimate(
            unit=self.case.info.unit,
            base=_geometric_mean(self.base),
            head=_geometric_mean(self.head),
            base_values=tuple(map(finite, self.base)),
            head_values=tuple(map(finite, self.head)),
            deviation=interval.deviation if interval is not None else None,
        )
        verdict = requirement_verdict(self.case, decision)
        return msgspec.structs.replace(verdict, unit="share", compared=estimate)

    def reason(self, interval: RatioInterval, pieces: str) -> str:
        base, head = (
            show(_geometric_mean([value for value in values if value]), self.case.info.unit)
            for values in (self.base, self.head)
        )
        ratio, lower, upper, limit = (
            show(value, "share", 4)
            for value in (interval.ratio, interval.lower, interval.upper, self.case.limit)
        )
        return (
            f"{self.case.info.name} went from {base} to {head}, {ratio} of the baseline over "
            f"{interval.n} {pieces}; at {self.case.confidence_text} the true ratio is {lower} to "
            f"{upper}, and the limit is {limit}."
        )

    def without_value(self) -> RequirementVerdict | None:
        """The verdict where a side has no value, or where a value is 0; else None."""
        unknown = self.without_head_value()
        if unknown is not None:
            return unknown
        lost = _count_missing(self.case, self.base)
        if lost or not self.base:
            return self.undecided(
                f"{self.case.info.name} has no value in {lost} of {len(self.base)} iterations of "
                "the base.",
                "Compare with a base that produces output.",
            )
        return self.with_zero()

    def without_head_value(self) -> RequirementVerdict | None:
        """The same for the head alone."""
        if not self.head:
            return self.undecided(
                f"The head has no iteration in which {self.case.info.name} could be measured."
            )
        lost = _count_missing(self.case, self.head)
        if not lost:
            return replace(self, base=()).with_zero()
        reason = (
            f"{self.case.info.name} has no value in {lost} of {len(self.head)} iterations of the "
            "head."
        )
        if self.case.sampled:
            return self.undecided(reason, "Make the iterations longer to get more samples.")
        return self.verdict("fail", reason)

    def with_zero(self) -> RequirementVerdict | None:
        """The verdict where a value is 0, such as a share of drops; else None."""
        if all(value is not None and value > 0 for value in (*self.base, *self.head)):
            return None
        return self.undecided(
            f"{self.case.info.name} is 0 in some iterations, and a ratio to 0 is undefined.",
            "Use an absolute bound, such as 0.1 %, instead of one 'of baseline'.",
        )


def judge_by_turns(case: BaselineCase, base: Values, head: Values) -> RequirementVerdict:
    """Decide by starts of both sides; see `r2bspec.judge.turn_comparison`."""
    sides = _Sides(case, "trimmed t by turns", base, head)
    unknown = sides.without_value()
    if unknown is not None:
        return unknown
    before, after = _known(base), _known(head)
    if len(before) < 2:
        return sides.undecided("A single start does not show how starts differ.")
    return sides.decided(ratio_of_starts(before, after, case.confidence), "starts of both", "")


def judge_pairs(case: BaselineCase, base: Values, head: Values) -> RequirementVerdict:
    """Decide by interleaved pairs: `base[i]` and `head[i]` were played one after the other."""
    sides = _Sides(case, "paired t on logs", base, head)
    unknown = sides.without_value()
    if unknown is not None:
        return unknown
    before, after = _known(base), _known(head)
    if len(before) != len(after):
        raise ValueError("base and head have different numbers of values")
    if len(before) < 2:
        return sides.undecided(
            "One pair does not show the variation between pairs.",
            "At least 2 pairs are needed; --pairs 10 gives a useful interval.",
        )
    interval = paired_ratio(before, after, case.confidence, case.resolution)
    return sides.decided(interval, "pairs", _pairs_hint(case, interval))


def _pairs_hint(case: BaselineCase, interval: RatioInterval) -> str:
    n, distance = interval.n, abs(math.log(interval.ratio / case.limit))
    half = math.log(interval.upper / interval.lower) / 2
    more = more_pieces(n, mean_decides(distance, half, n, case.confidence))
    if more is None:
        return (
            f"The ratio is too close to {show(case.limit, 'share')} for pairs that differ by "
            f"{show(interval.deviation, 'share')}: widen the margin, or use a quieter machine."
        )
    return f"{advice(more, 'pairs')[:-1]} (--pairs {n + more})."


def _count_missing(case: BaselineCase, values: Values) -> int:
    # 0 is an ordinary share of drops, and an ordinary jitter: something arrived.
    least = 0.0 if case.info.may_be_zero else math.ulp(0.0)
    return sum(value is None or not least <= value < math.inf for value in values)


def _geometric_mean(values: Values) -> float | None:
    """The geometric mean, so that the ratio of two is the mean ratio; None if one is missing."""
    usable = [value for value in values if value is not None and _usable(value)]
    if not usable or len(usable) < len(values):
        return None
    return math.exp(math.fsum(map(math.log, usable)) / len(usable))


def _usable(value: float) -> bool:
    return math.isfinite(value) and value > 0


def _known(values: Values) -> list[float]:
    return [value for value in values if value is not None]
