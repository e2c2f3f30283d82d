"""Objectives and samples in, a verdict out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import msgspec

from r2bspec.measure.catalogue import MetricInfo, resolve
from r2bspec.measure.errors import MetricError
from r2bspec.measure.samples import RunSamples, SegmentSamples
from r2bspec.measure.units import show
from r2bspec.slo.disturbance import split_disturbed, told_of, weaken
from r2bspec.slo.looks import combine
from r2bspec.slo.methods.mean import judge_mean
from r2bspec.slo.methods.observation import judge_observation
from r2bspec.slo.methods.percentile import judge_percentile
from r2bspec.slo.methods.search import judge_peak
from r2bspec.slo.methods.share import judge_share
from r2bspec.slo.methods.sustained import judge_sustained
from r2bspec.slo.methods.windows import judge_windows
from r2bspec.slo.model import EXIT_CODES, OverallOutcome, RequirementVerdict, Unusable, Verdict
from r2bspec.slo.question import Answer, Question, verdict, windows_of
from r2bspec.slo.schedule import REMEDY, off_schedule
from r2bspec.slo.severity import outcome_of
from r2bspec.slo.terms import Terms
from r2bspec.spec.model import Objective
from r2bspec.spec.requirement import Requirement

_AS_AGREED = Terms()


def judge(
    objectives: Mapping[str, Objective], samples: RunSamples, terms: Terms = _AS_AGREED
) -> Verdict:
    """Judge every requirement of every objective, and the run as a whole.

    A requirement passes or fails only if the samples show it at the stated confidence; otherwise
    it is inconclusive. What was not measured never passes. A metric of a monitor that is written
    without one must hold for each monitor, and gets a verdict for each.

    The verdict is a pure function of its arguments: where looks are planned, each is taken again
    from the iterations that it had.

    Args:
        objectives: by name.
        samples: the run.
        terms: what was agreed on before the run, and which iterations were disturbed.
    """
    schedule = _Schedule.of(samples)
    asked = {
        name: objective
        for name, objective in objectives.items()
        if terms.levels.get(name, "error") != "off"
    }
    played, calm = split_disturbed(samples, terms.disturbed)
    requirements = _looked(asked, played, terms, schedule)
    if calm is not None:
        without = _looked(asked, calm, terms, schedule)
        told = told_of(terms.disturbed)
        requirements = tuple(
            weaken(one, other, told) for one, other in zip(requirements, without, strict=True)
        )
    spoiled = tuple(
        Unusable(offered_hz=rate, reason=reason)
        for rate, reason in sorted({**schedule.probes, **schedule.iterations}.items())
        if any(one.reason == reason for one in requirements)
    )
    outcome, reason = _overall(samples, requirements, spoiled, terms)
    return Verdict(
        outcome=outcome,
        exit_code=EXIT_CODES[outcome],
        reason=reason,
        requirements=requirements,
        unusable=spoiled,
    )


def _looked(
    objectives: Mapping[str, Objective], samples: RunSamples, terms: Terms, schedule: _Schedule
) -> tuple[RequirementVerdict, ...]:
    """The verdicts after all looks that the run allows, or of its one fixed length."""
    looks = terms.looks
    if looks is None:
        return tuple(_judged(objectives, samples, terms, terms.confidence, schedule))
    rates = [objective.at.hz for objective in objectives.values() if objective.at is not None]
    fewest = min((len(_at(samples.iterations, rate)) for rate in rates), default=0)
    columns = [
        tuple(
            _judged(
                objectives,
                _first(samples, looks.iterations[look - 1]),
                terms,
                looks.confidence_at(look),
                schedule,
            )
        )
        for look in range(1, max(1, looks.reached(fewest)) + 1)
    ]
    return tuple(combine(looks, judged) for judged in zip(*columns, strict=True))


def _first(samples: RunSamples, number: int) -> RunSamples:
    """The run as it was when `number` iterations had been played at each rate."""
    return replace(
        samples,
        iterations={rate: found[:number] for rate, found in samples.iterations.items()},
    )


def _judged(
    objectives: Mapping[str, Objective],
    samples: RunSamples,
    terms: Terms,
    confidence: float,
    schedule: _Schedule,
) -> Iterator[RequirementVerdict]:
    for name, objective in objectives.items():
        level = terms.levels.get(name, "error")
        for requirement in objective.require:
            for found in _judge(name, objective, requirement, samples, schedule, confidence):
                yield msgspec.structs.replace(found, level=level) if level != "error" else found


@dataclass(frozen=True)
class _Schedule:
    """The offered rates at which the playback missed its schedule, and how.

    A sequential probe ends when its player cannot go on; one that held proves its rate.
    """

    iterations: Mapping[float, str]
    probes: Mapping[float, str]

    @classmethod
    def of(cls, samples: RunSamples) -> _Schedule:
        played = {rate: off_schedule(rate, found) for rate, found in samples.iterations.items()}
        probed = {
            probe.rate_hz: off_schedule(probe.rate_hz, [samples.sustained[probe.rate_hz]])
            for probe in samples.record.sustained
            if not probe.holds and probe.rate_hz in samples.sustained
        }
        return cls(
            {rate: reason for rate, reason in played.items() if reason},
            {rate: reason for rate, reason in probed.items() if reason},
        )

    def missed(self, question: Question) -> str:
        """Why what was measured for a question is unusable, or empty."""
        if question.info.statistic == "search" or question.at_hz is None:
            return ""
        found = self.probes if question.info.statistic == "sequential" else self.iterations
        return next(
            (reason for rate, reason in found.items() if math.isclose(rate, question.at_hz)), ""
        )


def _judge(
    name: str,
    objective: Objective,
    requirement: Requirement,
    samples: RunSamples,
    schedule: _Schedule,
    confidence: float,
) -> Iterator[RequirementVerdict]:
    at_hz = objective.at.hz if objective.at is not None else None
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
    for asked in samples.monitors if everywhere else (monitor,):
        question = Question(
            objective=name,
            requirement=requirement,
            at_hz=at_hz,
            info=info,
            monitor=asked,
            limit=_limit(requirement, at_hz),
            iterations=_at(samples.iterations, at_hz),
            confidence=confidence,
            windows=windows_of(requirement),
        )
        judged = verdict(question, _answer(question, samples))
        if missed := schedule.missed(question):
            judged = msgspec.structs.replace(
                judged, outcome="inconclusive", reason=missed, settle=REMEDY
            )
        yield judged


def _limit(requirement: Requirement, at_hz: float | None) -> float:
    bound = requirement.bound
    if bound is None:
        return math.nan
    if not bound.of_offered:
        return bound.value
    return bound.value * at_hz if at_hz is not None else math.nan


def _at(
    iterations: Mapping[float, tuple[SegmentSamples, ...]], at_hz: float | None
) -> tuple[SegmentSamples, ...]:
    if at_hz is None:
        return ()
    return next((found for rate, found in iterations.items() if math.isclose(rate, at_hz)), ())


def _answer(question: Question, samples: RunSamples) -> Answer:
    bound = question.requirement.bound
    if bound is not None and bound.of_offered and question.at_hz is None:
        return _nothing("The objective names no rate that 'of offered' could mean.")
    match question.info.statistic:
        case "search":
            return judge_peak(question, samples.record.search)
        case "sequential":
            return judge_sustained(question, samples.record.sustained)
    if question.at_hz is None:
        return _nothing(f"The objective does not say at which rate {question.info.name} is meant.")
    if not question.iterations:
        return _nothing(
            f"No complete iteration was played at {show(question.at_hz, 'Hz')}.",
            "Run the spec that states this objective, to its end.",
        )
    silent = _silence(question)
    return silent if silent is not None else _measured(question)


def _measured(question: Question) -> Answer:
    if question.windows is not None:
        return judge_windows(question, question.windows)
    if question.requirement.op in {"==", "!="}:
        return judge_observation(question)
    match question.info.statistic:
        case "percentile":
            return judge_percentile(question)
        case "share":
            return judge_share(question)
        case "mean":
            return judge_mean(question)
        case _:
            return judge_observation(question)


def _silence(question: Question) -> Answer | None:
    """A failure, if the monitor that is asked saw no output at all: it can't be good."""
    if question.monitor is None:
        return None
    seen = [one.monitors[question.monitor] for one in question.iterations]
    if any(one.answered for one in seen):
        return None
    received, sent = sum(one.received for one in seen), sum(one.sent for one in seen)
    if not received:
        reason = f"Monitor '{question.monitor}' received nothing for {show(sent, 'count')} inputs."
    else:
        reason = (
            f"Monitor '{question.monitor}' received {show(received, 'count')} messages, but none "
            "carries the stamp of an input: match them by order, or keep the stamp in the graph."
        )
    return Answer(outcome="fail", method="none", reason=reason, n=sent)


def _nothing(reason: str, settle: str = "") -> Answer:
    return Answer(outcome="inconclusive", method="none", reason=reason, settle=settle)


def _no_such_metric(
    name: str, requirement: Requirement, at_hz: float | None, problem: str, suggestion: str
) -> RequirementVerdict:
    """The verdict on a requirement that this run has nothing for: it is not met."""
    hint = f"; did you mean {suggestion}?" if suggestion else "."
    info = MetricInfo(requirement.metric, "probe", "none", "", "observation", "")
    question = Question(name, requirement, at_hz, info, None, math.nan)
    reason = f"{problem[:1].upper()}{problem[1:]}{hint}"
    return verdict(question, Answer(outcome="fail", method="none", reason=reason))


def _overall(
    samples: RunSamples,
    requirements: tuple[RequirementVerdict, ...],
    spoiled: tuple[Unusable, ...],
    terms: Terms,
) -> tuple[OverallOutcome, str]:
    """The outcome of the run, worst first, and one sentence for it."""
    record = samples.record
    if record.status == "invalid":
        return "invalid", record.reason or "The run is invalid."
    if record.status == "incomplete":
        return "incomplete", record.reason or "The run was cut short."
    if spoiled:
        return "invalid", f"At {show(spoiled[0].offered_hz, 'Hz')}: {spoiled[0].reason}"
    return outcome_of(requirements, terms.inconclusive)
