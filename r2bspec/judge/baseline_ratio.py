"""``of baseline``: a requirement on the ratio of a metric to what it was before a change.

    method                 rests on                                  decides
    paired t on logs       interleaved runs of base and head         PASS, FAIL, INCONCLUSIVE
    prediction interval    a history of runs, one plan, one host     PASS, FAIL, INCONCLUSIVE
    stored baseline        one stored run                            nothing: it advises

The limit is the margin, as a ratio: ``>= 97 % of baseline`` is 0.97. With the one-sided bounds on
the true ratio, a floor passes if the lower bound is at or over it and fails if the upper is below;
a ceiling the other way round. What has no value in one of the pairs (nothing arrived, a percentile
that falls on a lost message) is not left out: it fails for the head, and decides nothing for the
base. What was not sampled decides nothing for either, and neither does a share of 0, which has no
ratio.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from r2bspec.judge.decision import decide
from r2bspec.judge.methods.registry import Method
from r2bspec.judge.statistics.paired_ratio import RatioInterval, paired_ratio
from r2bspec.judge.statistics.power import pairs_needed
from r2bspec.judge.statistics.prediction_interval import LEAST_RUNS, predicted_ratio
from r2bspec.judge.statistics.welch_test import welch_ratio
from r2bspec.judge.verdict import Compared, Outcome, RequirementVerdict
from r2bspec.language.confidence import CONFIDENCE
from r2bspec.language.requirement_grammar import Requirement
from r2bspec.measure.units import show

Values = Sequence[float | None]
"""A metric in the iterations of one side; None or infinite where it has no value."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A requirement on a ratio, about to be judged.

    Attributes:
        limit: the ratio that is allowed or demanded, such as 0.97.
        unit: of the metric.
        resolution: the smallest difference that the clock can show in a value of the metric.
        sampled: whether a missing value means that nobody looked, and not that nothing came.
        zeros: whether 0 is a value like any other, as of a share of drops, and not the sign that
            nothing came.
    """

    objective: str
    requirement: Requirement
    at_hz: float | None
    metric: str
    monitor: str | None
    limit: float
    unit: str = ""
    resolution: float = 0.0
    sampled: bool = False
    zeros: bool = False
    confidence: float = CONFIDENCE

    @property
    def wants_less(self) -> bool:
        """Whether the requirement is a ceiling (``<``, ``<=``) and not a floor."""
        return self.requirement.op in {"<", "<="}


def judge_pairs(asked: Comparison, base: Values, head: Values) -> RequirementVerdict:
    """Decide by interleaved pairs: `base[i]` and `head[i]` were played next to each other."""
    method: Method = "paired t on logs"
    missing = _missing(asked, method, base, head)
    if missing is not None:
        return missing
    a, b = _known(base), _known(head)
    if len(a) != len(b):
        raise ValueError("base and head have different numbers of values")
    sides = _Sides(base, head)
    if len(a) < 2:
        return _verdict(
            asked,
            method,
            "inconclusive",
            "One pair does not show how much pairs differ.",
            sides,
            settle="At least 2 pairs are needed; 10 make a useful interval.",
        )
    found = paired_ratio(a, b, asked.confidence, asked.resolution)
    outcome = _decide(asked, found)
    settle = _more_pairs(asked, found) if outcome == "inconclusive" else ""
    reason = _reason(asked, found, sides, "pairs")
    return _verdict(asked, method, outcome, reason, sides, settle=settle, found=found)


def judge_history(asked: Comparison, history: Values, new: float | None) -> RequirementVerdict:
    """Decide by a history of runs of the same plan on the same kind of machine, oldest first."""
    method: Method = "prediction interval"
    earlier = [value for value in history if value is not None and _usable(value)]
    missing = _missing_head(asked, method, earlier, [new])
    if missing is not None:
        return missing
    sides = _Sides(earlier, [new])
    if len(earlier) < LEAST_RUNS:
        runs = "1 run" if len(earlier) == 1 else f"{len(earlier)} runs"
        return _verdict(
            asked,
            method,
            "inconclusive",
            f"The history holds {runs} of this plan on such a machine with a value of "
            f"{asked.metric}.",
            sides,
            settle=f"{LEAST_RUNS} are needed: {LEAST_RUNS - len(earlier)} more.",
        )
    found = predicted_ratio(earlier, _known([new])[0], asked.confidence)
    outcome = _decide(asked, found)
    settle = (
        "Runs differ by too much for this margin: compare interleaved pairs with --against."
        if outcome == "inconclusive"
        else ""
    )
    reason = _reason(asked, found, sides, "runs")
    return _verdict(asked, method, outcome, reason, sides, settle=settle, found=found)


def advise(asked: Comparison, base: Values, head: Values) -> RequirementVerdict:
    """Say what a single stored run suggests. The outcome is always inconclusive."""
    method: Method = "stored baseline"
    settle = "A stored run only advises: gate on interleaved pairs with --against."
    a = [value for value in base if value is not None and _usable(value)]
    b = [value for value in head if value is not None and _usable(value)]
    sides = _Sides(base, head)
    if min(len(a), len(b)) < 2:
        reason = "There are too few iterations with a value to compare with a stored run."
        return _verdict(asked, method, "inconclusive", reason, sides, settle=settle)
    found = welch_ratio(a, b, asked.confidence)
    would = {"pass": "would pass", "fail": "would fail", "inconclusive": "would be open"}
    seen = _reason(asked, found, sides, "iterations")
    reason = f"{seen} By this alone it {would[_decide(asked, found)]}."
    return _verdict(asked, method, "inconclusive", reason, sides, settle=settle, found=found)


@dataclass(frozen=True)
class _Sides:
    """The values that a ratio is of."""

    base: Values
    head: Values

    def compared(self, unit: str, deviation: float | None) -> Compared:
        return Compared(
            unit=unit,
            base=_middle(self.base),
            head=_middle(self.head),
            base_values=tuple(map(_finite, self.base)),
            head_values=tuple(map(_finite, self.head)),
            deviation=deviation,
        )


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _middle(values: Values) -> float | None:
    """The geometric mean, so that the ratio of two is the mean ratio; None if one is missing."""
    known = [value for value in values if value is not None and _usable(value)]
    if not known or len(known) < len(values):
        return None
    return math.exp(math.fsum(map(math.log, known)) / len(known))


def _usable(value: float) -> bool:
    return math.isfinite(value) and value > 0


def _known(values: Values) -> list[float]:
    return [value for value in values if value is not None]


def _missing(
    asked: Comparison, method: Method, base: Values, head: Values
) -> RequirementVerdict | None:
    """The verdict where a side has no value, or None."""
    found = _missing_head(asked, method, base, head)
    if found is not None:
        return found
    lost = _lost(asked, base)
    if lost or not base:
        reason = f"{asked.metric} has no value in {lost} of {len(base)} iterations of the base."
        settle = "Compare with a base that works."
        sides = _Sides(base, head)
        return _verdict(asked, method, "inconclusive", reason, sides, settle=settle)
    return _zeros(asked, method, base, head)


def _missing_head(
    asked: Comparison, method: Method, base: Values, head: Values
) -> RequirementVerdict | None:
    """The same where only the head is looked at."""
    lost = _lost(asked, head)
    sides = _Sides(base, head)
    if not lost and head:
        return _zeros(asked, method, (), head)
    if not head:
        reason = f"The head has no iteration in which {asked.metric} could be measured."
        return _verdict(asked, method, "inconclusive", reason, sides)
    reason = f"{asked.metric} has no value in {lost} of {len(head)} iterations of the head."
    if asked.sampled:
        settle = "Longer iterations leave time for more samples."
        return _verdict(asked, method, "inconclusive", reason, sides, settle=settle)
    return _verdict(asked, method, "fail", reason, sides)


def _lost(asked: Comparison, values: Values) -> int:
    least = 0.0 if asked.zeros else math.ulp(0.0)
    return sum(value is None or not least <= value < math.inf for value in values)


def _zeros(
    asked: Comparison, method: Method, base: Values, head: Values
) -> RequirementVerdict | None:
    """The verdict where a value is 0, such as a share of drops; or None."""
    if all(value is not None and value > 0 for value in (*base, *head)):
        return None
    reason = f"{asked.metric} is 0 in some iterations, and 0 has no ratio to anything."
    settle = "State a bound of its own, such as 0.1 %, instead of one of the baseline."
    return _verdict(asked, method, "inconclusive", reason, _Sides(base, head), settle=settle)


def _decide(asked: Comparison, found: RatioInterval) -> Outcome:
    towards, against = (
        (found.upper, found.lower) if asked.wants_less else (found.lower, found.upper)
    )
    holds = asked.requirement.is_met
    return decide(passes=holds(towards, asked.limit), fails=not holds(against, asked.limit))


def _reason(asked: Comparison, found: RatioInterval, sides: _Sides, what: str) -> str:
    base = show(_middle([each for each in sides.base if each]), asked.unit)
    head = show(_middle([each for each in sides.head if each]), asked.unit)
    ratio, lower, upper, limit = (
        show(each, "share", 4) for each in (found.ratio, found.lower, found.upper, asked.limit)
    )
    return (
        f"{asked.metric} went from {base} to {head}, {ratio} of the baseline over {found.n} "
        f"{what}; at {show(asked.confidence, 'share', 4)} confidence the true ratio is {lower} to "
        f"{upper}, and the limit is {limit}."
    )


def _more_pairs(asked: Comparison, found: RatioInterval) -> str:
    distance = abs(math.log(found.ratio / asked.limit))
    needed = (
        pairs_needed(distance, found.deviation, asked.confidence, power=0.5)
        if distance > 0 and found.deviation > 0
        else None
    )
    if needed is None:
        return (
            f"The ratio is too close to {show(asked.limit, 'share')} for pairs that differ by "
            f"{show(found.deviation, 'share')}: widen the margin, or calm the machine."
        )
    return f"About {max(needed, found.n + 1)} pairs would settle it, if the ratio stays what it is."


def _verdict(
    asked: Comparison,
    method: Method,
    outcome: Outcome,
    reason: str,
    sides: _Sides,
    *,
    settle: str = "",
    found: RatioInterval | None = None,
) -> RequirementVerdict:
    n = found.n if found is not None else len(sides.base)
    return RequirementVerdict(
        objective=asked.objective,
        text=asked.requirement.text,
        at_hz=asked.at_hz,
        metric=asked.metric,
        monitor=asked.monitor,
        outcome=outcome,
        method=method,
        estimate=found.ratio if found is not None else None,
        lower=found.lower if found is not None else None,
        upper=found.upper if found is not None else None,
        limit=asked.limit,
        unit="share",
        n=n,
        effective_n=float(n) if n else None,
        confidence=asked.confidence,
        over=None,
        lost=False,
        share=None,
        rule_of_three=None,
        reason=reason,
        settle=settle,
        compared=sides.compared(asked.unit, found.deviation if found is not None else None),
    )
