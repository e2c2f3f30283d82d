"""One requirement and the samples of a run in, its verdicts out."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Final

import msgspec

from r2bspec.judge.decision import Answer, Decider, Question, requirement_verdict, window_condition
from r2bspec.judge.methods import method_registry
from r2bspec.judge.playback_validity import REMEDY, TIMELINE_REMEDY, PlaybackValidity
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.language.requirement_grammar import Requirement
from r2bspec.language.spec import Objective
from r2bspec.measure.errors import MetricError
from r2bspec.measure.metric_catalogue import MetricInfo, available_live, resolve
from r2bspec.measure.samples import MonitorSamples, RunSamples, SegmentSamples
from r2bspec.measure.units import show

OWN_RATE: Final = 0.0
"""Stands for the rate of what has one of its own: a recording, or the source of a live graph."""


def judge_requirement(
    name: str,
    objective: Objective,
    requirement: Requirement,
    samples: RunSamples,
    playback_validity: PlaybackValidity,
    confidence: float,
) -> Iterator[RequirementVerdict]:
    """The verdicts on one requirement: one, or one for each monitor.

    Args:
        name: of the objective.
        objective: that the requirement belongs to.
        requirement: what is asked.
        samples: the run.
        playback_validity: the rates at which the playback missed its schedule.
        confidence: of the decision, one-sided each way.
    """
    at_hz = objective_rate(objective, samples)
    try:
        monitor, info = resolve(requirement.metric, samples.monitors, samples.processes)
    except MetricError as error:
        yield _no_such_metric(name, requirement, at_hz, str(error), error.suggestion)
        return
    bound = requirement.bound
    if bound is not None and not info.accepts(bound):
        message = (
            f"the metric {info.name} is a {info.dimension}, but its bound is a {bound.dimension}"
        )
        yield _no_such_metric(name, requirement, at_hz, message, "")
        return
    everywhere = info.scope == "monitor" and monitor is None
    for monitor_name in samples.monitors if everywhere else (monitor,):
        question = Question(
            objective=name,
            requirement=requirement,
            at_hz=at_hz,
            info=info,
            monitor=monitor_name,
            limit=limit_of(requirement, at_hz, info, _per_step(samples, at_hz, monitor_name)),
            iterations=iterations_at(samples.iterations, at_hz),
            confidence=confidence,
            windows=window_condition(requirement),
        )
        judged = requirement_verdict(question, _answer(question, samples))
        if missed := playback_validity.problem(info.statistic, at_hz):
            judged = msgspec.structs.replace(
                judged,
                outcome="inconclusive",
                reason=missed,
                settle=REMEDY if at_hz else TIMELINE_REMEDY,
            )
        yield judged


def objective_rate(objective: Objective, samples: RunSamples) -> float | None:
    """The offered rate that an objective speaks of.

    Returns:
        None if it speaks of none, or of a peak that the search has not found; 0 where the
        recording, or the graph's own source, says how fast messages come.
    """
    if objective.at is not None:
        return objective.at.hz
    if samples.own_rate and not objective.at_peak:
        return OWN_RATE
    return samples.peak_hz if objective.at_peak else None


def limit_of(
    requirement: Requirement, at_hz: float | None, info: MetricInfo, per_step: float = 1.0
) -> float:
    """The right-hand side of a requirement in its metric's unit; NaN where it has none.

    Args:
        requirement: with its bound.
        at_hz: the offered rate, which 'of offered' means.
        info: the metric.
        per_step: outputs that a step lets a monitor expect.
    """
    bound = requirement.bound
    if bound is None or bound.of_baseline:
        return math.nan
    if not bound.of_offered:
        return bound.value
    if not at_hz:
        return math.nan
    # Of a monitor with a ratio as many outputs are offered as the steps let expect.
    return bound.value * at_hz * (per_step if info.scope == "monitor" else 1.0)


def _per_step(samples: RunSamples, at_hz: float | None, monitor: str | None) -> float:
    played = iterations_at(samples.iterations, at_hz)
    return played[0].monitors[monitor].per_step if played and monitor is not None else 1.0


def iterations_at(
    iterations: Mapping[float, tuple[SegmentSamples, ...]], at_hz: float | None
) -> tuple[SegmentSamples, ...]:
    """The iterations at a rate; none if there is no rate."""
    if at_hz is None:
        return ()
    return next((found for rate, found in iterations.items() if math.isclose(rate, at_hz)), ())


def _answer(question: Question, samples: RunSamples) -> Answer:
    bound = question.requirement.bound
    if samples.mode == "live" and not available_live(question.info):
        return _inconclusive(
            f"Nobody knows {question.info.name} of a live run: what its source sent is not seen."
        )
    if bound is not None and bound.of_offered and not question.at_hz:
        return _inconclusive("The objective names no rate that 'of offered' could mean.")
    if bound is not None and bound.of_baseline:
        return _inconclusive(
            "This run has nothing to be compared with.",
            "Run with --against, or keep a history of runs.",
        )
    decider = decider_of(question)
    if not decider.needs_iterations:
        return decider.decide(question, samples.record)
    if question.at_hz is None:
        return _inconclusive(
            f"The objective does not say at which rate {question.info.name} is meant."
        )
    if not question.iterations:
        at = f" at {show(question.at_hz, 'Hz')}" if question.at_hz else ""
        return _inconclusive(
            f"No complete iteration was played{at}.",
            "Run the spec that states this objective, to its end.",
        )
    silent = _no_output(question)
    return silent if silent is not None else decider.decide(question, samples.record)


def decider_of(question: Question) -> Decider:
    """The method that decides a requirement on one run: the first that takes it."""
    return next(each for each in _deciders() if each.takes(question))


@cache
def _deciders() -> tuple[Decider, ...]:
    package = method_registry.__package__
    modules = [importlib.import_module(f"{package}.{name}") for name in method_registry.DECIDERS]
    return tuple(module.DECIDER for module in modules)


def _no_output(question: Question) -> Answer | None:
    """A failure, if the monitor that is asked saw no output at all: it can't be good."""
    if question.monitor is None:
        return None
    seen = [one.monitors[question.monitor] for one in question.iterations]
    if any(one.answered for one in seen):
        return _unknown_latency(question, seen)
    if seen[0].live:
        count = len(seen)
        reason = f"Monitor '{question.monitor}' received nothing in {show(count, 'count')} "
        reason += "iterations." if count > 1 else "iteration."
        return Answer(outcome="fail", method="none", reason=reason)
    received, sent = sum(one.received for one in seen), sum(one.sent for one in seen)
    if not received:
        reason = f"Monitor '{question.monitor}' received nothing for {show(sent, 'count')} inputs."
    else:
        reason = (
            f"Monitor '{question.monitor}' received {show(received, 'count')} messages, but none "
            "carries the stamp of an input: match them by order, or keep the stamp in the graph."
        )
    return Answer(outcome="fail", method="none", reason=reason, n=sent)


def _unknown_latency(question: Question, seen: Sequence[MonitorSamples]) -> Answer | None:
    """That a live latency is unknown, if in an iteration it is."""
    wanted = question.info.family == "latency" and seen[0].live
    if wanted and any(one.received and not one.times["latency"].size for one in seen):
        return _inconclusive(
            f"What monitor '{question.monitor}' received carries no time of this machine's clock.",
            "Let the source stamp its messages with the system time.",
        )
    return None


def _inconclusive(reason: str, settle: str = "") -> Answer:
    return Answer(outcome="inconclusive", method="none", reason=reason, settle=settle)


def _no_such_metric(
    name: str, requirement: Requirement, at_hz: float | None, problem: str, suggestion: str
) -> RequirementVerdict:
    """The verdict on a requirement that this run has nothing for: it is not met."""
    hint = f"; did you mean {suggestion}?" if suggestion else "."
    info = MetricInfo(requirement.metric, "probe", "none", "", "observation", "")
    question = Question(name, requirement, at_hz, info, None, math.nan)
    reason = f"{problem[:1].upper()}{problem[1:]}{hint}"
    return requirement_verdict(question, Answer(outcome="fail", method="none", reason=reason))
