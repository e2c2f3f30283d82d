"""A bound on a mean, by t over the iterations.

One value for each iteration: messages within one are too much alike to count one by one, and the
difference between iterations is the noise that a second run would show. Iterations that resemble
their neighbours count as fewer.
"""

from __future__ import annotations

import math

from r2bspec.judge.decision import Answer, Decider, Question, decide
from r2bspec.judge.statistics.autocorrelation import serial_inflation
from r2bspec.judge.statistics.t_interval import MeanInterval, iterations_to_settle, mean_interval
from r2bspec.judge.verdict import Outcome
from r2bspec.measure.metric_catalogue import MetricInfo
from r2bspec.measure.metric_values import metric_value
from r2bspec.measure.samples import SegmentSamples
from r2bspec.measure.units import show

_MAX_ITERATIONS = 200
"""More than this many are not worth proposing."""

_CLOCK_RESOLUTION_S = 1e-6
"""Times are taken by software between system calls: nothing below a microsecond means anything."""

_CPU_TICK_S = 0.01
"""Linux accounts processor time in ticks of 10 ms."""

_PAGE_BYTES = 4096.0


def judge_mean(question: Question) -> Answer:
    """Decide a requirement on a mean."""
    values: list[float] = []
    for one in question.iterations:
        found = metric_value(question.info, question.monitor, one)
        if found is None:
            return _no_value(question, one)
        values.append(found)
    if len(values) < 2:
        estimate = values[0] if values else None
        return Answer(
            outcome="inconclusive",
            method="t over iterations",
            reason=f"One iteration ({show(estimate, question.info.unit)}) does not show how much "
            "iterations differ.",
            settle="At least 2 iterations are needed; 5 or more make a useful interval.",
            estimate=estimate,
            n=len(values),
        )
    inflation = serial_inflation(values)
    interval = mean_interval(values, question.confidence, _resolution(question, values), inflation)
    towards, against = (
        (interval.upper, interval.lower)
        if question.is_upper_bound
        else (interval.lower, interval.upper)
    )
    outcome = decide(passes=question.holds(towards), fails=not question.holds(against))
    return Answer(
        outcome=outcome,
        method="t over iterations",
        reason=_reason(question, interval, outcome, len(values), inflation),
        settle=_settle(question, interval, inflation) if outcome == "inconclusive" else "",
        estimate=interval.mean,
        lower=interval.lower,
        upper=interval.upper,
        n=len(values),
        effective_n=len(values) / inflation,
    )


def _no_value(question: Question, iteration: SegmentSamples) -> Answer:
    """An iteration without a value: too few outputs fail, samples not taken decide nothing."""
    where = f"iteration {iteration.segment.index}"
    if question.monitor is not None:
        return Answer(
            outcome="fail",
            method="none",
            reason=f"Monitor '{question.monitor}' received too little in {where} for a "
            f"{question.info.name}.",
        )
    return Answer(
        outcome="inconclusive",
        method="none",
        reason=f"{question.info.name} was not sampled in {where}.",
        settle="Longer iterations leave time for more samples.",
    )


def _resolution(question: Question, values: list[float]) -> float:
    """The smallest difference in a value of this metric that the clocks can show."""
    segment = question.iterations[0].segment
    window_s = (segment.ended_ns - segment.began_ns) / 1e9
    return resolution(question.info, max(values), max(window_s, _CLOCK_RESOLUTION_S))


def resolution(info: MetricInfo, typical: float, window_s: float) -> float:
    """The resolution of a metric of the size `typical` over a window of `window_s` seconds."""
    match info.dimension:
        case "time":
            return _CLOCK_RESOLUTION_S
        case "rate":
            return typical * _CLOCK_RESOLUTION_S / window_s
        case "share":
            return _CPU_TICK_S / window_s
        case "size":
            return _PAGE_BYTES
        case _:
            return 0.0


def _reason(
    question: Question, interval: MeanInterval, outcome: Outcome, n: int, inflation: float
) -> str:
    unit = question.info.unit
    mean = f"The mean of {n} iterations is {show(interval.mean, unit)}"
    if inflation > 1:
        mean += f" (each resembles the one before it, so that they count as {n / inflation:.2g})"
    lower, upper = show(interval.lower, unit), show(interval.upper, unit)
    sure = f"at {question.confidence_text}"
    if outcome == "inconclusive":
        return (
            f"{mean}; {sure} the true mean is {lower} to {upper}, on both sides of "
            f"{question.limit_text}."
        )
    bound = question.requirement.bound
    limit = f"; the limit is {question.limit_text}" if bound and bound.of_offered else ""
    if (outcome == "pass") == question.is_upper_bound:
        return f"{mean}, {sure} at most {upper}{limit}."
    return f"{mean}, {sure} at least {lower}{limit}."


def _settle(question: Question, interval: MeanInterval, inflation: float) -> str:
    needed = iterations_to_settle(
        interval.mean, interval.deviation, question.limit, question.confidence, _MAX_ITERATIONS
    )
    if needed is None:
        return (
            f"The mean is too close to {question.limit_text} for iterations that differ by "
            f"{show(interval.deviation, question.info.unit)}: move the limit, or calm the machine."
        )
    needed = max(math.ceil(needed * inflation), len(question.iterations) + 1)
    return f"About {needed} iterations would settle it, if mean and scatter stay what they are."


DECIDER = Decider(
    takes=lambda question: question.info.statistic == "mean" and not question.is_equality,
    decide=lambda question, _: judge_mean(question),
)
