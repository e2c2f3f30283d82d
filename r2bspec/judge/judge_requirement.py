"""Judges one requirement by the samples of a run."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Final

import msgspec

from r2bspec.judge.decision import Answer, Decider, Question, requirement_verdict, window_condition
from r2bspec.judge.methods import method_registry
from r2bspec.judge.playback_validity import PlaybackValidity
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.language.requirement_grammar import Requirement
from r2bspec.language.spec import Objective
from r2bspec.measure.metric_catalogue import (
    MetricError,
    MetricInfo,
    available_live,
    kind_of,
    resolve,
)
from r2bspec.measure.metrics import pool_monitor
from r2bspec.measure.samples import (
    LOSS_SENSITIVE_FAMILIES,
    MonitorSamples,
    RunSamples,
    SegmentSamples,
)
from r2bspec.measure.units import show

OWN_RATE: Final = 0.0
"""The rate where none is offered: that of a recording, or of the source of a live graph."""

_HIDDEN_LOSSES: Final = (
    "Outputs are matched by order: a lost one and another that came twice cancel out."
)


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
        requirement: to be judged.
        samples: the run.
        playback_validity: the rates at which the results are invalid.
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
    for monitor_name in _monitors(info, monitor, samples):
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
        if _losses_may_hide(question):
            judged = msgspec.structs.replace(judged, notes=(*judged.notes, _HIDDEN_LOSSES))
        if missed := playback_validity.problem(info.statistic, at_hz):
            judged = msgspec.structs.replace(
                judged,
                outcome="inconclusive",
                reason=missed,
                remedy=playback_validity.remedy(missed, at_hz),
                # They explain a verdict that is none.
                notes=(),
            )
        yield judged


def _monitors(info: MetricInfo, monitor: str | None, samples: RunSamples) -> tuple[str | None, ...]:
    """The monitors that a requirement is judged for; None where it belongs to none."""
    if monitor is not None:
        return (monitor,)
    if info.scope == "truth":
        kind = kind_of(info.name)
        compared = [one.monitor for one in samples.record.accuracy if one.kind == kind]
        return tuple(compared) or (None,)
    return samples.monitors if info.scope == "monitor" else (None,)


def _losses_may_hide(question: Question) -> bool:
    """Whether lost outputs are counted, and others may take their places."""
    return question.info.name in {"drop_rate", "missed"} and any(
        one.monitors[question.monitor or ""].by_order for one in question.iterations
    )


def objective_rate(objective: Objective, samples: RunSamples) -> float | None:
    """The offered rate of an objective.

    Returns:
        None if it has none, or if it is at a peak that the search has not found; 0 where the
        recording, or the graph's own source, sets the rate.
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
            f"{question.info.name} is unknown in a live run: what its source sent is not recorded."
        )
    if bound is not None and bound.of_offered and not question.at_hz:
        return _inconclusive("The objective has no rate, so 'of offered' has no meaning.")
    if bound is not None and bound.of_baseline:
        return _inconclusive(
            "This run was not compared with a baseline.",
            "Run with --against or --history.",
        )
    decider = decider_of(question)
    if not decider.needs_iterations:
        return decider.decide(question, samples.record)
    if question.at_hz is None:
        return _inconclusive(f"The objective does not state the rate of {question.info.name}.")
    if not question.iterations:
        at = f" at {show(question.at_hz, 'Hz')}" if question.at_hz else ""
        return _inconclusive(
            f"No complete iteration was played{at}.",
            "Run the spec of this objective to its end.",
        )
    no_output = _no_output(question)
    return no_output if no_output is not None else decider.decide(question, samples.record)


def decider_of(question: Question) -> Decider:
    """The method that decides a requirement on one run: the first that accepts it."""
    return next(each for each in _deciders() if each.takes(question))


@cache
def _deciders() -> tuple[Decider, ...]:
    package = method_registry.__package__
    modules = [importlib.import_module(f"{package}.{name}") for name in method_registry.DECIDERS]
    return tuple(module.DECIDER for module in modules)


def _no_output(question: Question) -> Answer | None:
    """A failure if the monitor received no output at all."""
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
    overdue = sum(one.overdue for one in seen)
    if overdue:
        reason = (
            f"Monitor '{question.monitor}' received no answer in time for {show(sent, 'count')} "
            f"inputs, and {show(overdue, 'count')} in a later segment: increase "
            "'benchmark.drain_timeout' to measure how late they are."
        )
    elif not received:
        reason = f"Monitor '{question.monitor}' received nothing for {show(sent, 'count')} inputs."
    else:
        reason = (
            f"Monitor '{question.monitor}' received {show(received, 'count')} messages, but none "
            "has the stamp of an input: use 'match: order', or copy the stamp inside the graph."
        )
    return Answer(outcome="fail", method="none", reason=reason, n=sent)


def _unknown_latency(question: Question, seen: Sequence[MonitorSamples]) -> Answer | None:
    """The answer for a latency that is unknown in some iteration; else None."""
    if unpaired := latency_unknown_by_order(question.info, question.monitor, question.iterations):
        return _inconclusive(*unpaired)
    wanted = question.info.family == "latency" and seen[0].live
    if wanted and any(one.received and not one.times["latency"].size for one in seen):
        return _inconclusive(
            f"The messages at monitor '{question.monitor}' have no stamp of this machine's clock.",
            "Stamp the messages of the source with the system time.",
        )
    return None


def latency_unknown_by_order(
    info: MetricInfo, monitor: str | None, iterations: Sequence[SegmentSamples]
) -> tuple[str, str] | None:
    """Why a latency is unknown where outputs are matched by order, and what to do; else None."""
    if monitor is None or info.family not in LOSS_SENSITIVE_FAMILIES:
        return None
    seen = [one.monitors[monitor] for one in iterations]
    if not any(one.unknown_latency for one in seen):
        return None
    reason = (
        f"The latency at monitor '{monitor}' is unknown: {pool_monitor(seen).unknown_latency}. "
        "Every later one may then answer another input."
    )
    return reason, "Match by stamp: use an output whose header keeps the stamp of its input."


def _inconclusive(reason: str, remedy: str = "") -> Answer:
    return Answer(outcome="inconclusive", method="none", reason=reason, remedy=remedy)


def _no_such_metric(
    name: str, requirement: Requirement, at_hz: float | None, problem: str, suggestion: str
) -> RequirementVerdict:
    """The verdict on a requirement whose metric this run does not have: not met."""
    hint = f"; did you mean {suggestion}?" if suggestion else "."
    info = MetricInfo(requirement.metric, "probe", "none", "", "observation", "")
    question = Question(name, requirement, at_hz, info, None, math.nan)
    reason = f"{problem[:1].upper()}{problem[1:]}{hint}"
    return requirement_verdict(question, Answer(outcome="fail", method="none", reason=reason))
