"""Objectives and samples in, a verdict out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import msgspec

from r2bspec.judge.affected_iterations import favoured, find_disturbed, told_of, undisturbed, weaken
from r2bspec.judge.decision_policy import Terms
from r2bspec.judge.interim_looks import Looks, combine
from r2bspec.judge.judge_requirement import iterations_at, judge_requirement, rate_of
from r2bspec.judge.outcome import outcome_of
from r2bspec.judge.playback_validity import Schedule
from r2bspec.judge.verdict import (
    EXIT_CODES,
    DisturbedIteration,
    OverallOutcome,
    RequirementVerdict,
    Unusable,
    Verdict,
)
from r2bspec.language.spec import Objective
from r2bspec.measure.samples import RunSamples
from r2bspec.measure.units import show

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
        terms: what was agreed on before the run.
    """
    schedule = Schedule.of(samples)
    asked = {name: objective for name, objective in objectives.items() if objective.level != "off"}
    disturbed = find_disturbed(samples)
    requirements = _looked(asked, samples, terms, schedule)
    if disturbed and any(one.outcome == "fail" for one in requirements):
        requirements = _in_light_of(disturbed, requirements, asked, samples, terms, schedule)
    spoiled = tuple(
        Unusable(offered_hz=rate, reason=reason)
        for rate, reason in sorted({**schedule.probes, **schedule.iterations}.items())
        # Where nothing is required, the figures themselves are what the run was for.
        if not requirements or any(one.reason == reason for one in requirements)
    )
    outcome, reason = _overall(samples, requirements, spoiled, terms)
    return Verdict(
        outcome=outcome,
        exit_code=EXIT_CODES[outcome],
        reason=reason,
        requirements=requirements,
        unusable=spoiled,
        disturbed=tuple(disturbed.values()),
    )


def _in_light_of(
    disturbed: Mapping[str, DisturbedIteration],
    requirements: tuple[RequirementVerdict, ...],
    objectives: Mapping[str, Objective],
    samples: RunSamples,
    terms: Terms,
    schedule: Schedule,
) -> tuple[RequirementVerdict, ...]:
    """Verdicts on all iterations as they were played, after a look at the disturbed ones."""
    calm = _looked(objectives, undisturbed(samples, disturbed), terms, schedule)
    best = _looked(objectives, favoured(samples, disturbed), terms, schedule)
    return tuple(
        weaken(one, without, told_of(one, disturbed), favoured_one)
        for one, without, favoured_one in zip(requirements, calm, best, strict=True)
    )


def _looked(
    objectives: Mapping[str, Objective], samples: RunSamples, terms: Terms, schedule: Schedule
) -> tuple[RequirementVerdict, ...]:
    """The verdicts after all looks that the run allows, or of its one fixed length."""
    looks = terms.looks
    if looks is None:
        return tuple(_judged(objectives, samples, terms, schedule))
    rates = {rate_of(objective, samples) for objective in objectives.values()} - {None}
    fewest = min((len(iterations_at(samples.iterations, rate)) for rate in rates), default=0)
    columns = [
        _judged(
            objectives, _first(samples, looks.iterations[look - 1]), terms, schedule, (looks, look)
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
    schedule: Schedule,
    at: tuple[Looks, int] | None = None,
) -> Iterator[RequirementVerdict]:
    """The verdicts on all requirements, at the confidence of a look where there are any."""
    for name, objective in objectives.items():
        confidence = (
            objective.confidence.fraction if objective.confidence is not None else terms.confidence
        )
        if at is not None:
            looks, look = at
            confidence = looks.confidence_at(look, confidence)
        for requirement in objective.require:
            for found in judge_requirement(
                name, objective, requirement, samples, schedule, confidence
            ):
                yield msgspec.structs.replace(found, level=objective.level)


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
        rate_hz, why = spoiled[0].offered_hz, spoiled[0].reason
        return "invalid", f"At {show(rate_hz, 'Hz')}: {why}" if rate_hz else why
    return outcome_of(requirements, terms.inconclusive)
