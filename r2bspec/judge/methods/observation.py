"""Compares an observed value with the limit: minimum, maximum, counts, and all with == or !=.

An observation describes this run, not the next one. The rule of three bounds what it may have
missed: if none of n messages broke a bound, up to about 3/n of all may, at 95 % confidence.
"""

from __future__ import annotations

import math

import numpy as np

from r2bspec.judge.decision import Answer, Decider, Question
from r2bspec.judge.statistics.rule_of_three import zero_failure_bound
from r2bspec.judge.verdict_wording import counted_noun
from r2bspec.measure.metric_values import metric_value
from r2bspec.measure.metrics import pool_monitor
from r2bspec.measure.samples import LOSS_SENSITIVE_FAMILIES, MonitorSamples
from r2bspec.measure.times import percentile
from r2bspec.measure.units import show

_COUNT_METRICS = ("sent", "received", "missed", "duplicates", "reordered", "unmatched")
_FAULT_COUNTS = ("missed", "duplicates", "reordered", "unmatched")
"""Counts of faults: where none was observed, the rule of three applies."""


def judge_observation(question: Question) -> Answer:
    """Compare the observed value of all iterations with the limit."""
    seen = observed_value(question)
    if seen is None:
        return Answer(
            outcome="inconclusive",
            method="none",
            reason=f"{question.info.name} has no value in these iterations.",
        )
    n = _count_messages(question)
    is_met = question.is_met(seen)
    counts = is_met and n > 0 and _bounds_single_messages(question, seen)
    rule = zero_failure_bound(n, question.confidence) if counts else None
    return Answer(
        outcome="pass" if is_met else "fail",
        method="observation",
        reason=_reason(question, seen, n, rule),
        estimate=seen,
        n=n,
        rule_of_three=rule,
    )


def observed_value(question: Question) -> float | None:
    """The value over all iterations: extremes of extremes, sums of counts, the mean of means."""
    info = question.info
    if info.quantile is not None:
        return _pooled_percentile(question, info.quantile)
    values = [
        found
        for one in question.iterations
        if (found := metric_value(info, question.monitor, one)) is not None
    ]
    if not values:
        return None
    if info.name in _COUNT_METRICS:
        return sum(values)
    if info.name == "drop_rate":
        pooled = pool_monitor(_monitor_samples(question))
        return pooled.missed / pooled.expected if pooled.expected else None
    if info.part == "min":
        return min(values)
    return max(values) if info.part == "max" else sum(values) / len(values)


def _pooled_percentile(question: Question, quantile: float) -> float | None:
    family = question.info.family
    if question.info.scope == "playback":
        lateness = np.concatenate([one.playback.lateness for one in question.iterations])
        return percentile(lateness, quantile)
    pooled = pool_monitor(_monitor_samples(question))
    lost = pooled.missed if family in LOSS_SENSITIVE_FAMILIES else 0
    return percentile(pooled.times[family], quantile, lost)


def _monitor_samples(question: Question) -> list[MonitorSamples]:
    return [one.monitors[question.monitor or ""] for one in question.iterations]


def _count_messages(question: Question) -> int:
    """The number of observed messages; for processes, which have none, of iterations."""
    info = question.info
    if info.scope == "monitor":
        seen = _monitor_samples(question)
        if info.family in seen[0].times and info.family not in LOSS_SENSITIVE_FAMILIES:
            return sum(one.times[info.family].size for one in seen)
        return sum(one.expected for one in seen)
    if info.scope == "playback":
        return sum(one.playback.sent for one in question.iterations)
    return len(question.iterations)


def _bounds_single_messages(question: Question, seen: float) -> bool:
    """Whether the observation is that no single message broke the bound."""
    info = question.info
    if info.scope not in {"monitor", "playback"}:
        return False
    return info.part in {"min", "max"} or (info.name in _FAULT_COUNTS and seen == 0)


def _reason(question: Question, seen: float, n: int, rule: float | None) -> str:
    what = _observation_text(question, seen, n)
    if rule is None:
        return f"{what}."
    return (
        f"{what}. This is an observation, not a proof: at {question.confidence_text} up to "
        f"{show(rule, 'share', 2)} of {counted_noun(question)} may still break the limit."
    )


def _observation_text(question: Question, seen: float, n: int) -> str:
    info = question.info
    if info.part in {"min", "max"}:
        extreme = "smallest" if info.part == "min" else "largest"
        if math.isinf(seen):
            missed = sum(one.missed for one in _monitor_samples(question))
            return f"{show(missed, 'count')} of {show(n, 'count')} outputs never arrived"
        of = f"{show(n, 'count')} {counted_noun(question)}"
        if info.scope not in {"monitor", "playback"}:
            of = f"{n} iteration{'s' if n > 1 else ''}"
        return f"The {extreme} in {of} is {show(seen, info.unit)}"
    if info.name in _COUNT_METRICS:
        if question.iterations[0].live:
            count = len(question.iterations)
            return f"Observed {show(seen, 'count')} in {count} iteration{'s' if count > 1 else ''}"
        return f"Observed {show(seen, 'count')} in {show(n, 'count')} steps"
    return f"{info.name} is {show(seen, info.unit)}"


DECIDER = Decider(
    takes=lambda _: True,
    decide=lambda question, _: judge_observation(question),
)
