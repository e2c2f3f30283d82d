"""Predictions as frozen values, and what they say of the requirements of a plan."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Literal

import msgspec

from r2bspec.judge.measure.distribution import quantile as quantile_of
from r2bspec.judge.measure.units import show
from r2bspec.judge.statistics.percentile_interval import allowed_share
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.plan.plan import Plan

Answer = Literal["would hold", "would not", "not known"]


class Estimate(msgspec.Struct, frozen=True, kw_only=True):
    """A predicted value with its 90 % interval, in seconds or hertz.

    Attributes:
        value: None if it is not known; infinity if messages would be lost without end.
        low: known without the others where all that is known is that it is above.
        reason: why it is not known; else empty.
    """

    value: float | None = None
    low: float | None = None
    high: float | None = None
    reason: str = ""


class LatencyPrediction(msgspec.Struct, frozen=True, kw_only=True):
    """A percentile of the latency of a monitor at a rate; `metric` is such as ``latency.p99``."""

    monitor: str
    metric: str
    rate_hz: float
    estimate: Estimate


class RequirementPrediction(msgspec.Struct, frozen=True, kw_only=True):
    """Whether a requirement would hold.

    Attributes:
        level: of its objective.
        rate_hz: at which it was asked; None for the peak.
        reason: what the answer is about: the interval, or why nothing is known.
    """

    objective: str
    level: str
    text: str
    rate_hz: float | None
    answer: Answer
    reason: str


class Prediction(msgspec.Struct, frozen=True, kw_only=True):
    """What a deployment would do.

    Attributes:
        cores: of the machine that it is for.
        loads: the load of the busiest thread at each rate, with its process.
        reason: why nothing at all is known; else empty.
    """

    name: str
    cores: int
    latencies: tuple[LatencyPrediction, ...] = ()
    peak: Estimate = Estimate()
    loads: tuple[tuple[float, str, float], ...] = ()
    requirements: tuple[RequirementPrediction, ...] = ()
    reason: str = ""

    @property
    def rules_out(self) -> str:
        """Why the deployment is not worth a trial: the first requirement that it would not meet."""
        for each in self.requirements:
            if each.answer == "would not" and each.level == "error":
                return f"{each.text}: {each.reason}"
        return ""


def nothing_known(plan: Plan, cores: int, reason: str) -> Prediction:
    """The prediction of a deployment of which the model knows nothing."""
    return Prediction(
        name=plan.name,
        cores=cores,
        peak=Estimate(reason=reason),
        requirements=tuple(
            RequirementPrediction(
                objective=name,
                level=objective.level,
                text=each.text,
                rate_hz=None,
                answer="not known",
                reason=reason,
            )
            for name, objective in plan.objectives.items()
            for each in objective.require
        ),
        reason=reason,
    )


def requirement_answers(
    plan: Plan, rates: Sequence[float], latencies: Sequence[LatencyPrediction], peak: Estimate
) -> Iterator[RequirementPrediction]:
    """Whether the requirements of a plan would hold.

    Those at a rate that was not predicted are asked at each rate that was.
    """
    monitors = frozenset(monitor.name for monitor in plan.monitors)
    for name, objective in plan.objectives.items():
        for required in objective.require:
            at_hz = objective.at.si if objective.at is not None else None
            own = [rate for rate in rates if at_hz is not None and math.isclose(rate, at_hz)]
            of_rate = required.metric != "peak.rate"
            for rate_hz in (own or rates) if of_rate else (None,):
                if rate_hz is None:
                    answer, reason = _compared(required, peak, "Hz")
                else:
                    answer, reason = _at_rate(required, rate_hz, latencies, peak, monitors)
                yield RequirementPrediction(
                    objective=name,
                    level=objective.level,
                    text=required.text,
                    rate_hz=rate_hz,
                    answer=answer,
                    reason=reason,
                )


def _at_rate(
    required: Requirement,
    rate_hz: float,
    latencies: Sequence[LatencyPrediction],
    peak: Estimate,
    monitors: frozenset[str],
) -> tuple[Answer, str]:
    """The answer at one rate, and why."""
    first, _, rest = required.metric.partition(".")
    metric = rest if first in monitors else required.metric
    about = [
        each
        for each in latencies
        if math.isclose(each.rate_hz, rate_hz) and (first not in monitors or each.monitor == first)
    ]
    asked = [each.estimate for each in about if each.metric == metric]
    overloads = peak.high is not None and rate_hz > peak.high
    if metric == "sustained":
        holds = peak.low is not None and rate_hz < peak.low
        answer: Answer = "would not" if overloads else "would hold" if holds else "not known"
        return answer, f"peak.rate {_range(peak, 'Hz')}"
    quantile = quantile_of(metric.rpartition(".")[2])
    if not asked and quantile is not None and metric.startswith("latency."):
        asked = [*_between(quantile, about)]
    if not asked or required.windows_share is not None:
        return "not known", "the model says nothing of this metric"
    if overloads and required.op in {"<", "<="} and quantile is not None:
        # With a short queue, those that are not lost may be as fast as ever.
        late = 1 - (peak.high or 0.0) / rate_hz
        keeps_up = f"the graph keeps up to {show(peak.high, 'Hz')} at most"
        return "would not" if late > allowed_share(quantile) else "not known", keeps_up
    # It must hold for each of the monitors that it is about.
    answers = dict(reversed([_compared(required, each, "s") for each in asked]))
    worst = next(each for each in ("would not", "not known", "would hold") if each in answers)
    return worst, answers[worst]


def _between(quantile: float, latencies: Sequence[LatencyPrediction]) -> Iterator[Estimate]:
    """Of each monitor, what its predicted percentiles say of another one, which is between them."""
    of_monitor: dict[str, dict[float, Estimate]] = {}
    for each in latencies:
        ends = {0.0: Estimate(low=0.0, high=0.0), 1.0: Estimate(low=math.inf, high=math.inf)}
        known = quantile_of(each.metric.rpartition(".")[2])
        if known is not None:
            of_monitor.setdefault(each.monitor, ends)[known] = each.estimate
    for estimates in of_monitor.values():
        below = estimates[max(at for at in estimates if at <= quantile)]
        above = estimates[min(at for at in estimates if at >= quantile)]
        unknown = next((end for end in (below, above) if end.low is None), None)
        yield unknown or Estimate(low=below.low, high=above.high)


def _compared(required: Requirement, estimate: Estimate, unit: str) -> tuple[Answer, str]:
    bound = required.bound
    if estimate.low is None:
        return "not known", estimate.reason
    if bound is None or bound.of_offered or bound.of_baseline:
        return "not known", "its limit is relative to what is measured"
    high = math.inf if estimate.high is None else estimate.high
    met = {required.is_met(value, bound.value) for value in (estimate.low, high)}
    if required.op in {"==", "!="} or len(met) > 1:
        return "not known", _range(estimate, unit)
    return ("would hold" if met == {True} else "would not"), _range(estimate, unit)


def _range(estimate: Estimate, unit: str) -> str:
    """The interval; why it is not known where it is not."""
    if estimate.low is None or estimate.high is None:
        return estimate.reason
    if math.isinf(estimate.high):
        return f"more than {show(estimate.low, unit)}"
    return f"{show(estimate.low, unit)} … {show(estimate.high, unit)}"
