"""One requirement of one objective, about to be judged, and how its verdict is put together."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from r2bspec.judge.methods.method_registry import Method
from r2bspec.judge.statistics.effective_sample_size import SampleDesign
from r2bspec.judge.verdict import Outcome, RequirementVerdict, ShareTest
from r2bspec.language.confidence import CONFIDENCE
from r2bspec.language.requirement_grammar import Requirement
from r2bspec.measure.metric_catalogue import MetricInfo
from r2bspec.measure.samples import SegmentSamples, starts_of
from r2bspec.measure.units import show
from r2bspec.record.run_record import RunRecord


@dataclass(frozen=True)
class WindowCondition:
    """``in SHARE of LENGTH windows``: the share of windows, as a fraction, and their length."""

    share: float
    window_ns: int


def window_condition(requirement: Requirement) -> WindowCondition | None:
    """The windows that a requirement refers to, or None if it refers to the whole run."""
    if requirement.windows_share is None:
        return None
    return WindowCondition(share=requirement.windows_share, window_ns=requirement.window_ns)


@dataclass(frozen=True)
class Question:
    """A requirement that applies to this run, and the samples to judge it by.

    Attributes:
        at_hz: the offered rate of the objective, or None.
        monitor: the monitor, for metrics that belong to one.
        limit: the right-hand side in the metric's unit; 'of offered' is worked out.
        iterations: the complete iterations at `at_hz`; at least one where the metric needs any.
        confidence: of the decision, one-sided each way.
        windows: the share of windows in which the requirement must be met, if it has one.
    """

    objective: str
    requirement: Requirement
    at_hz: float | None
    info: MetricInfo
    monitor: str | None
    limit: float
    iterations: tuple[SegmentSamples, ...] = ()
    confidence: float = CONFIDENCE
    windows: WindowCondition | None = None

    @property
    def is_upper_bound(self) -> bool:
        """Whether the requirement is an upper limit (``<``, ``<=``) and not a lower one."""
        return self.requirement.op in {"<", "<="}

    @property
    def is_equality(self) -> bool:
        """Whether the requirement is ``==`` or ``!=``, which only an observation can decide."""
        return self.requirement.op in {"==", "!="}

    def design(self, allowed: float | None = None) -> SampleDesign:
        """How the iterations came about, for a test of a share.

        Args:
            allowed: the share that is tested.
        """
        return SampleDesign(
            starts=starts_of(self.iterations), allowed=allowed, confidence=self.confidence
        )

    @property
    def limit_text(self) -> str:
        """The limit with its unit."""
        return show(self.limit, self.info.unit)

    @property
    def metric_text(self) -> str:
        """Such as ``latency.p99 < 50 ms``: the comparison without monitor and windows."""
        return f"{self.info.name} {self.requirement.op} {self.limit_text}"

    @property
    def confidence_text(self) -> str:
        """Such as ``95 % confidence``."""
        return f"{show(self.confidence, 'share', 4)} confidence"

    def is_met(self, value: float) -> bool:
        """Compare a value with the limit."""
        return self.requirement.is_met(value, self.limit)


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What a method found; see `RequirementVerdict` for the fields."""

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
    bursts: int | None = None
    share: ShareTest | None = None
    rule_of_three: float | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Decider:
    """A method, as its module provides it to `r2bspec.judge.methods.method_registry`.

    Attributes:
        takes: whether the method decides a requirement.
        decide: decides it, by the iterations of the question or by the record of the run.
        needs_iterations: whether it cannot decide without a complete iteration.
    """

    takes: Callable[[Question], bool]
    decide: Callable[[Question, RunRecord], Answer]
    needs_iterations: bool = True


def decide(*, passes: bool, fails: bool) -> Outcome:
    """The outcome of two tests that cannot both succeed."""
    if passes:
        return "pass"
    return "fail" if fails else "inconclusive"


def requirement_verdict(question: Question, answer: Answer) -> RequirementVerdict:
    """Combine question and answer; infinite values become None, which JSON can write."""
    return RequirementVerdict(
        objective=question.objective,
        text=question.requirement.text,
        at_hz=question.at_hz,
        metric=question.info.name,
        monitor=question.monitor,
        outcome=answer.outcome,
        method=answer.method,
        estimate=_finite(answer.estimate),
        lower=_finite(answer.lower),
        upper=_finite(answer.upper),
        limit=_finite(question.limit),
        unit=question.info.unit,
        n=answer.n,
        effective_n=_effective(answer),
        confidence=question.confidence,
        over=answer.over,
        bursts=answer.bursts,
        lost=answer.estimate is not None and math.isinf(answer.estimate),
        share=answer.share,
        rule_of_three=answer.rule_of_three,
        reason=answer.reason,
        remedy=answer.remedy,
        notes=answer.notes,
    )


def _effective(answer: Answer) -> float | None:
    if answer.effective_n is not None:
        return answer.effective_n
    return float(answer.n) if answer.n else None


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
