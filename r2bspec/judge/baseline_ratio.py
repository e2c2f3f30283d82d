"""``of baseline``: a requirement on the ratio of a metric to its value before a change.

    method                 based on                                  decides
    paired t on logs       interleaved runs of base and head         PASS, FAIL, INCONCLUSIVE
    prediction interval    a history of runs, one plan, one host     PASS, FAIL, INCONCLUSIVE
    stored baseline        one stored run                            nothing: advisory

The limit is the margin, as a ratio: ``>= 97 % of baseline`` is 0.97. With the one-sided bounds on
the true ratio, a lower limit passes if the lower bound is at or over it and fails if the upper
bound is below it; an upper limit the other way round. A metric without a value in one of the pairs
(nothing arrived, a percentile that falls on a lost message) is not left out: it fails for the head,
and decides nothing for the base. A metric that was not sampled decides nothing for either, and
neither does a share of 0, which has no ratio.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import msgspec

from r2bspec.judge.decision import decide
from r2bspec.judge.methods.method_registry import Method
from r2bspec.judge.statistics.paired_ratio import RatioInterval, paired_ratio
from r2bspec.judge.statistics.power import pairs_needed
from r2bspec.judge.statistics.prediction_interval import MIN_HISTORY_RUNS, predicted_ratio
from r2bspec.judge.statistics.welch_t import RunValues, welch_ratio_of_runs
from r2bspec.judge.verdict import Compared, Outcome, RequirementVerdict
from r2bspec.language.confidence import CONFIDENCE
from r2bspec.language.requirement_grammar import Requirement
from r2bspec.measure.units import show

Values = Sequence[float | None]
"""A metric in the iterations of one side; None or infinite where it has no value."""


@dataclass(frozen=True, kw_only=True)
class BaselineComparison:
    """A requirement on a ratio, about to be judged.

    Attributes:
        limit: the ratio that is allowed or required, such as 0.97.
        unit: of the metric.
        resolution: the smallest difference that the clock can show in a value of the metric.
        sampled: whether a missing value means that nothing was sampled, not that nothing arrived.
        zero_allowed: whether 0 is an ordinary value, as for a share of drops, and does not mean
            that nothing arrived.
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
    zero_allowed: bool = False
    confidence: float = CONFIDENCE

    @property
    def is_upper_bound(self) -> bool:
        """Whether the requirement is an upper limit (``<``, ``<=``) and not a lower one."""
        return self.requirement.op in {"<", "<="}


def judge_pairs(comparison: BaselineComparison, base: Values, head: Values) -> RequirementVerdict:
    """Decide by interleaved pairs: `base[i]` and `head[i]` were played one after the other."""
    method: Method = "paired t on logs"
    missing = _missing_value_verdict(comparison, method, base, head)
    if missing is not None:
        return missing
    a, b = _known(base), _known(head)
    if len(a) != len(b):
        raise ValueError("base and head have different numbers of values")
    sides = _ComparedValues(base, head)
    if len(a) < 2:
        return _verdict(
            comparison,
            method,
            "inconclusive",
            "One pair does not show the variation between pairs.",
            sides,
            remedy="At least 2 pairs are needed; 10 give a useful interval.",
        )
    found = paired_ratio(a, b, comparison.confidence, comparison.resolution)
    outcome = _decide(comparison, found)
    remedy = _pairs_hint(comparison, found) if outcome == "inconclusive" else ""
    reason = _reason(comparison, found, sides, "pairs")
    return _verdict(comparison, method, outcome, reason, sides, remedy=remedy, found=found)


def judge_history(
    comparison: BaselineComparison, history: Values, new: float | None
) -> RequirementVerdict:
    """Decide by a history of runs of the same plan on the same kind of machine, oldest first."""
    method: Method = "prediction interval"
    earlier = [value for value in history if value is not None and _usable(value)]
    missing = _missing_head_verdict(comparison, method, earlier, [new])
    if missing is not None:
        return missing
    sides = _ComparedValues(earlier, [new])
    if len(earlier) < MIN_HISTORY_RUNS:
        runs = "1 run" if len(earlier) == 1 else f"{len(earlier)} runs"
        learning = f"{len(earlier) + 1} of {MIN_HISTORY_RUNS}"
        short = _verdict(
            comparison,
            method,
            "inconclusive",
            f"Learning, {learning}: the history has {runs} of this plan on this kind of machine "
            f"with a value of {comparison.metric}.",
            sides,
            remedy=f"{MIN_HISTORY_RUNS} are needed: {MIN_HISTORY_RUNS - len(earlier)} more.",
        )
        return msgspec.structs.replace(short, learning=learning)
    found = predicted_ratio(earlier, _known([new])[0], comparison.confidence)
    outcome = _decide(comparison, found)
    remedy = (
        "Runs vary too much for this margin: compare interleaved pairs with --against."
        if outcome == "inconclusive"
        else ""
    )
    reason = _reason(comparison, found, sides, "runs")
    return _verdict(comparison, method, outcome, reason, sides, remedy=remedy, found=found)


@dataclass(frozen=True)
class StoredValues:
    """A metric in the iterations of one run, and the start of each; empty if not known."""

    values: Values
    starts: Sequence[int] = ()

    def usable(self) -> RunValues:
        """Those of which a ratio can be made."""
        kept = [place for place, value in enumerate(self.values) if value and _usable(value)]
        return RunValues(
            values=[self.values[place] or 0.0 for place in kept],
            starts=[self.starts[place] for place in kept]
            if len(self.starts) == len(self.values)
            else (),
        )


def advise_by_stored_run(
    comparison: BaselineComparison, base: StoredValues, head: StoredValues
) -> RequirementVerdict:
    """State what a single stored run suggests. The outcome is always inconclusive."""
    method: Method = "stored baseline"
    remedy = "A stored run is advisory only: gate on interleaved pairs with --against."
    a, b = base.usable(), head.usable()
    sides = _ComparedValues(base.values, head.values)
    if min(len(a.values), len(b.values)) < 2:
        reason = "Too few iterations have a value to be compared with a stored run."
        return _verdict(comparison, method, "inconclusive", reason, sides, remedy=remedy)
    found, pieces = welch_ratio_of_runs(a, b, comparison.confidence)
    would = {"pass": "would pass", "fail": "would fail", "inconclusive": "would be inconclusive"}
    seen = _reason(comparison, found, sides, pieces)
    reason = f"{seen} By this alone it {would[_decide(comparison, found)]}."
    return _verdict(comparison, method, "inconclusive", reason, sides, remedy=remedy, found=found)


@dataclass(frozen=True)
class _ComparedValues:
    """The values that a ratio is of."""

    base: Values
    head: Values

    def compared(self, unit: str, deviation: float | None) -> Compared:
        return Compared(
            unit=unit,
            base=_geometric_mean(self.base),
            head=_geometric_mean(self.head),
            base_values=tuple(map(_finite, self.base)),
            head_values=tuple(map(_finite, self.head)),
            deviation=deviation,
        )


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _geometric_mean(values: Values) -> float | None:
    """The geometric mean, so that the ratio of two is the mean ratio; None if one is missing."""
    known = [value for value in values if value is not None and _usable(value)]
    if not known or len(known) < len(values):
        return None
    return math.exp(math.fsum(map(math.log, known)) / len(known))


def _usable(value: float) -> bool:
    return math.isfinite(value) and value > 0


def _known(values: Values) -> list[float]:
    return [value for value in values if value is not None]


def _missing_value_verdict(
    comparison: BaselineComparison, method: Method, base: Values, head: Values
) -> RequirementVerdict | None:
    """The verdict where a side has no value, or None."""
    found = _missing_head_verdict(comparison, method, base, head)
    if found is not None:
        return found
    lost = _count_missing(comparison, base)
    if lost or not base:
        reason = (
            f"{comparison.metric} has no value in {lost} of {len(base)} iterations of the base."
        )
        remedy = "Compare with a base that produces output."
        sides = _ComparedValues(base, head)
        return _verdict(comparison, method, "inconclusive", reason, sides, remedy=remedy)
    return _zero_verdict(comparison, method, base, head)


def _missing_head_verdict(
    comparison: BaselineComparison, method: Method, base: Values, head: Values
) -> RequirementVerdict | None:
    """The same for the head alone."""
    lost = _count_missing(comparison, head)
    sides = _ComparedValues(base, head)
    if not lost and head:
        return _zero_verdict(comparison, method, (), head)
    if not head:
        reason = f"The head has no iteration in which {comparison.metric} could be measured."
        return _verdict(comparison, method, "inconclusive", reason, sides)
    reason = f"{comparison.metric} has no value in {lost} of {len(head)} iterations of the head."
    if comparison.sampled:
        remedy = "Make the iterations longer to get more samples."
        return _verdict(comparison, method, "inconclusive", reason, sides, remedy=remedy)
    return _verdict(comparison, method, "fail", reason, sides)


def _count_missing(comparison: BaselineComparison, values: Values) -> int:
    least = 0.0 if comparison.zero_allowed else math.ulp(0.0)
    return sum(value is None or not least <= value < math.inf for value in values)


def _zero_verdict(
    comparison: BaselineComparison, method: Method, base: Values, head: Values
) -> RequirementVerdict | None:
    """The verdict where a value is 0, such as a share of drops; or None."""
    if all(value is not None and value > 0 for value in (*base, *head)):
        return None
    reason = f"{comparison.metric} is 0 in some iterations, and a ratio to 0 is undefined."
    remedy = "Use an absolute bound, such as 0.1 %, instead of one 'of baseline'."
    return _verdict(
        comparison, method, "inconclusive", reason, _ComparedValues(base, head), remedy=remedy
    )


def _decide(comparison: BaselineComparison, found: RatioInterval) -> Outcome:
    towards, against = (
        (found.upper, found.lower) if comparison.is_upper_bound else (found.lower, found.upper)
    )
    is_met = comparison.requirement.is_met
    return decide(
        passes=is_met(towards, comparison.limit), fails=not is_met(against, comparison.limit)
    )


def _reason(
    comparison: BaselineComparison, found: RatioInterval, sides: _ComparedValues, what: str
) -> str:
    base = show(_geometric_mean([each for each in sides.base if each]), comparison.unit)
    head = show(_geometric_mean([each for each in sides.head if each]), comparison.unit)
    ratio, lower, upper, limit = (
        show(each, "share", 4) for each in (found.ratio, found.lower, found.upper, comparison.limit)
    )
    return (
        f"{comparison.metric} went from {base} to {head}, {ratio} of the baseline over {found.n} "
        f"{what}; at {show(comparison.confidence, 'share', 4)} confidence the true ratio "
        f"is {lower} to "
        f"{upper}, and the limit is {limit}."
    )


def _pairs_hint(comparison: BaselineComparison, found: RatioInterval) -> str:
    distance = abs(math.log(found.ratio / comparison.limit))
    needed = (
        pairs_needed(distance, found.deviation, comparison.confidence, power=0.5)
        if distance > 0 and found.deviation > 0
        else None
    )
    if needed is None:
        return (
            f"The ratio is too close to {show(comparison.limit, 'share')} for pairs that differ by "
            f"{show(found.deviation, 'share')}: widen the margin, or use a quieter machine."
        )
    return f"About {max(needed, found.n + 1)} pairs would decide it, if the ratio stays the same."


def _verdict(
    comparison: BaselineComparison,
    method: Method,
    outcome: Outcome,
    reason: str,
    sides: _ComparedValues,
    *,
    remedy: str = "",
    found: RatioInterval | None = None,
) -> RequirementVerdict:
    n = found.n if found is not None else len(sides.base)
    return RequirementVerdict(
        objective=comparison.objective,
        text=comparison.requirement.text,
        at_hz=comparison.at_hz,
        metric=comparison.metric,
        monitor=comparison.monitor,
        outcome=outcome,
        method=method,
        estimate=found.ratio if found is not None else None,
        lower=found.lower if found is not None else None,
        upper=found.upper if found is not None else None,
        limit=comparison.limit,
        unit="share",
        n=n,
        effective_n=float(n) if n else None,
        confidence=comparison.confidence,
        over=None,
        lost=False,
        share=None,
        rule_of_three=None,
        reason=reason,
        remedy=remedy,
        compared=sides.compared(comparison.unit, found.deviation if found is not None else None),
    )
