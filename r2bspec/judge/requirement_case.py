"""A requirement of an objective, about to be judged, and the assembly of its verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from r2bspec.judge.measure.metric import MetricInfo, Scope
from r2bspec.judge.measure.metric_values import lost_outputs, message_values, values_with_lost
from r2bspec.judge.measure.sample_table import MonitorSamples
from r2bspec.judge.measure.samples import SegmentSamples, starts_of
from r2bspec.judge.measure.times import Seconds
from r2bspec.judge.measure.units import show
from r2bspec.judge.methods import Method
from r2bspec.judge.statistics.t_interval import scatter_level
from r2bspec.judge.verdict import Outcome, RequirementVerdict, ShareTest
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.record.run_record import RunRecord

MAX_LOST_SHARE: Final = 0.01
"""A mean latency over a larger share of lost outputs does not PASS."""


@dataclass(frozen=True)
class RequirementCase:
    """A requirement that applies to this run, and the samples to judge it by.

    Attributes:
        at_hz: the offered rate of the objective, or None.
        monitor: the monitor, for metrics that belong to one.
        limit: the right-hand side in the metric's unit; 'of offered' is worked out.
        iterations: the complete iterations at `at_hz`; at least one where the metric needs any.
        confidence: the confidence of the decision, one-sided each way.
    """

    objective: str
    requirement: Requirement
    at_hz: float | None
    info: MetricInfo
    monitor: str | None
    limit: float
    iterations: tuple[SegmentSamples, ...] = ()
    confidence: float = CONFIDENCE

    @property
    def monitor_samples(self) -> list[MonitorSamples]:
        """The samples of the monitor in each iteration; empty for a metric of no monitor."""
        if self.monitor is None:
            return []
        return [iteration.monitors[self.monitor] for iteration in self.iterations]

    @property
    def message_values(self) -> list[Seconds]:
        """The values of single messages in each iteration, in order, without lost ones."""
        return [message_values(self.info, self.monitor, one) for one in self.iterations]

    @property
    def lost(self) -> int:
        """The expected outputs that never came, if these count as slower than every other."""
        return sum(lost_outputs(self.info, self.monitor, one) for one in self.iterations)

    def values_by_iteration(self) -> tuple[list[Seconds], int]:
        """Return the messages of each iteration, in order, and how many are lost (infinite)."""
        worst = math.inf if self.is_upper_bound else -math.inf
        values = [values_with_lost(self.info, self.monitor, one, worst) for one in self.iterations]
        return values, self.lost

    @property
    def is_upper_bound(self) -> bool:
        """Whether the requirement is an upper limit (``<``, ``<=``) and not a lower one."""
        return self.requirement.op in {"<", "<="}

    @property
    def is_equality(self) -> bool:
        """Whether the requirement is ``==`` or ``!=``, which only an observation can decide."""
        return self.requirement.op in {"==", "!="}

    @property
    def starts(self) -> tuple[int, ...]:
        """The start of each iteration."""
        return starts_of(self.iterations)

    @property
    def level(self) -> float:
        """The confidence of t quantiles for differences between starts and iterations."""
        return scatter_level(self.confidence)

    @property
    def pieces(self) -> tuple[int, str]:
        """The number of starts, or of iterations of a single start, and the noun for them."""
        starts = len(set(self.starts))
        return (starts, "starts") if starts > 1 else (len(self.iterations), "iterations")

    @property
    def limit_text(self) -> str:
        """The limit with its unit."""
        return show(self.limit, self.info.unit)

    @property
    def confidence_text(self) -> str:
        """The confidence in words, such as ``95 % confidence``."""
        return f"{show(self.confidence, 'share', 4)} confidence"

    def is_met(self, value: float) -> bool:
        """Compare a value with the limit."""
        return self.requirement.is_met(value, self.limit)

    def outcome_of_bounds(self, lower: float, upper: float) -> Outcome:
        """Return PASS if both bounds on the true value meet the limit, FAIL if neither does."""
        towards, against = (upper, lower) if self.is_upper_bound else (lower, upper)
        return decide(passes=self.is_met(towards), fails=not self.is_met(against))


@dataclass(frozen=True, kw_only=True)
class Decision:
    """The decision of a method: fields of `RequirementVerdict`."""

    outcome: Outcome
    method: Method
    reason: str
    remedy: str = ""
    estimate: float | None = None
    lower: float | None = None
    upper: float | None = None
    n: int = 0
    effective_n: float | None = None
    over: int | None = None
    share: ShareTest | None = None
    rule_of_three: float | None = None
    untested: str = ""
    notes: tuple[str, ...] = ()


def undecided(reason: str, remedy: str = "") -> Decision:
    """Return the decision on a case that no test can decide, with a remedy."""
    return Decision(outcome="inconclusive", method="none", reason=reason, remedy=remedy)


def unmeasured(case: RequirementCase, record: RunRecord) -> Decision | None:
    """Return the decision on a device metric without a value, with the reason; else None."""
    if case.info.scope is not Scope.DEVICE:
        return None
    device = "package" if "package" in case.info.name else "gpu"
    why = record.machine.get(f"{device}_unmeasured") or "the machine did not report it all the time"
    return undecided(f"{case.info.name} was not measured: {why}.")


def decide(*, passes: bool, fails: bool) -> Outcome:
    """Return the outcome of two tests that cannot both succeed."""
    if passes:
        return "pass"
    return "fail" if fails else "inconclusive"


def limit_of(
    requirement: Requirement, at_hz: float | None, info: MetricInfo, per_step: float = 1.0
) -> float:
    """Return the right-hand side of a requirement in its metric's unit; NaN without one.

    Args:
        requirement: with its bound.
        at_hz: the offered rate, to which 'of offered' refers.
        info: the metric.
        per_step: outputs expected at a monitor for each step.
    """
    bound = requirement.bound
    if bound is None or bound.of_baseline:
        return math.nan
    if not bound.of_offered:
        return bound.value
    if not at_hz:
        return math.nan
    # For a monitor with a ratio, the offered rate is that of the expected outputs.
    return bound.value * at_hz * (per_step if info.scope is Scope.MONITOR else 1.0)


def requirement_verdict(case: RequirementCase, decision: Decision) -> RequirementVerdict:
    """Combine case and decision; infinite values become None, which JSON can write."""
    found = vars(decision) | {
        name: finite(getattr(decision, name)) for name in ("estimate", "lower", "upper")
    }
    if decision.effective_n is None and decision.n:
        found["effective_n"] = float(decision.n)
    return RequirementVerdict(
        objective=case.objective,
        text=case.requirement.text,
        at_hz=case.at_hz,
        metric=case.info.name,
        monitor=case.monitor,
        limit=finite(case.limit),
        unit=case.info.unit,
        confidence=case.confidence,
        lost=decision.estimate is not None and math.isinf(decision.estimate),
        **found,
    )


def finite(value: float | None) -> float | None:
    """Return the value, or None if it is infinite, which JSON cannot write."""
    return value if value is not None and math.isfinite(value) else None
