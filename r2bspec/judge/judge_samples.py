"""Judges objectives by the samples of a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import msgspec

from r2bspec.judge.affected_iterations import (
    affected_iterations_text,
    best_case_run,
    find_affected_iterations,
    weaken_failure,
    without_affected,
)
from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.interference_policy import judge_probes, judge_starts, strict_pass
from r2bspec.judge.interim_looks import InterimLooks, combine_looks
from r2bspec.judge.judge_requirement import iterations_at, judge_requirement, objective_rate
from r2bspec.judge.outcome import outcome_of
from r2bspec.judge.peak_refutation import with_refuted_peak
from r2bspec.judge.playback_validity import PlaybackValidity
from r2bspec.judge.run_limits import run_limits, with_limits
from r2bspec.judge.statistics.rule_of_three import zero_failure_bound
from r2bspec.judge.verdict import (
    EXIT_CODES,
    DisturbedIteration,
    OverallOutcome,
    RequirementVerdict,
    Unusable,
    Verdict,
)
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.language.spec import Objective
from r2bspec.measure.samples import RunSamples
from r2bspec.measure.units import show

_DEFAULT_POLICY = DecisionPolicy()
_SMOKE_REASON = "The graph works; a smoke run does not judge the SLOs."


def judge(
    objectives: Mapping[str, Objective],
    samples: RunSamples,
    policy: DecisionPolicy = _DEFAULT_POLICY,
) -> Verdict:
    """Judge every requirement of every objective, and the run as a whole.

    A requirement passes or fails only if the samples show it at the stated confidence; otherwise
    it is inconclusive. What was not measured never passes. A metric of a monitor that is written
    without one must be met at each monitor, and gets a verdict for each.

    The verdict is a pure function of its arguments: where interim looks are planned, each is
    repeated on the iterations that it had.

    Args:
        objectives: by name.
        samples: the run.
        policy: as the plan stated it before the run.
    """
    samples = with_refuted_peak(samples)
    playback_validity = PlaybackValidity.of(samples)
    judged_objectives = {
        name: objective for name, objective in objectives.items() if objective.level != "off"
    }
    disturbed = find_affected_iterations(samples)
    requirements = _judge_looks(judged_objectives, samples, policy, playback_validity)
    if disturbed and policy.interference != "tolerate":
        requirements = _weaken_affected(
            disturbed, requirements, judged_objectives, samples, policy, playback_validity
        )
    requirements = judge_probes(requirements, samples.record, policy.interference)
    requirements = judge_starts(requirements, samples, policy.interference)
    unusable = tuple(
        Unusable(offered_hz=rate, reason=reason)
        for rate, reason in sorted(
            {**playback_validity.probes, **playback_validity.iterations}.items()
        )
        # Without requirements the run was made for its figures alone.
        if not requirements or any(one.reason == reason for one in requirements)
    )
    outcome, reason = _overall_outcome(samples, requirements, unusable, policy)
    judged = outcome not in {"invalid", "incomplete"}
    return Verdict(
        outcome=outcome,
        exit_code=EXIT_CODES[outcome],
        reason=reason,
        requirements=with_limits(requirements, samples) if judged else requirements,
        unusable=unusable,
        disturbed=tuple(disturbed.values()),
        starts=samples.starts if judged else 0,
        unseen_starts=zero_failure_bound(samples.starts, CONFIDENCE),
        limits=run_limits(requirements, samples) if judged else (),
    )


def _weaken_affected(
    disturbed: Mapping[str, DisturbedIteration],
    requirements: tuple[RequirementVerdict, ...],
    objectives: Mapping[str, Objective],
    samples: RunSamples,
    policy: DecisionPolicy,
    playback_validity: PlaybackValidity,
) -> tuple[RequirementVerdict, ...]:
    """Verdicts on all iterations as they were played, with regard to host interference."""
    strict = policy.interference == "strict"
    outcomes = {one.outcome for one in requirements}
    if "fail" not in outcomes and not (strict and "pass" in outcomes):
        return requirements
    unaffected = _judge_looks(
        objectives, without_affected(samples, disturbed), policy, playback_validity
    )
    best_case = _judge_looks(
        objectives, best_case_run(samples, disturbed), policy, playback_validity
    )
    texts = [affected_iterations_text(one, disturbed) for one in requirements]
    found = tuple(
        weaken_failure(one, without, text, best_case_one)
        for one, without, text, best_case_one in zip(
            requirements, unaffected, texts, best_case, strict=True
        )
    )
    if not strict:
        return found
    return tuple(
        strict_pass(one, without, disturbed, text)
        for one, without, text in zip(found, unaffected, texts, strict=True)
    )


def _judge_looks(
    objectives: Mapping[str, Objective],
    samples: RunSamples,
    policy: DecisionPolicy,
    playback_validity: PlaybackValidity,
) -> tuple[RequirementVerdict, ...]:
    """The verdicts after all looks that the run allows, or of its one fixed length."""
    looks = policy.looks
    if looks is None:
        return tuple(_judge_requirements(objectives, samples, policy, playback_validity))
    rates = {objective_rate(objective, samples) for objective in objectives.values()} - {None}
    fewest = min((len(iterations_at(samples.iterations, rate)) for rate in rates), default=0)
    columns = [
        _judge_requirements(
            objectives,
            _truncated(samples, looks.iterations[look - 1]),
            policy,
            playback_validity,
            (looks, look),
        )
        for look in range(1, max(1, looks.completed_looks(fewest)) + 1)
    ]
    return tuple(combine_looks(looks, judged) for judged in zip(*columns, strict=True))


def _truncated(samples: RunSamples, number: int) -> RunSamples:
    """The run as it was when `number` iterations had been played at each rate."""
    return replace(
        samples,
        iterations={rate: found[:number] for rate, found in samples.iterations.items()},
    )


def _judge_requirements(
    objectives: Mapping[str, Objective],
    samples: RunSamples,
    policy: DecisionPolicy,
    playback_validity: PlaybackValidity,
    at: tuple[InterimLooks, int] | None = None,
) -> Iterator[RequirementVerdict]:
    """The verdicts on all requirements, at the confidence of a look where there are any."""
    for name, objective in objectives.items():
        confidence = (
            objective.confidence.fraction if objective.confidence is not None else policy.confidence
        )
        if at is not None:
            looks, look = at
            confidence = looks.confidence_at(look, confidence)
        for requirement in objective.require:
            for found in judge_requirement(
                name, objective, requirement, samples, playback_validity, confidence
            ):
                yield msgspec.structs.replace(found, level=objective.level)


def _overall_outcome(
    samples: RunSamples,
    requirements: tuple[RequirementVerdict, ...],
    unusable: tuple[Unusable, ...],
    policy: DecisionPolicy,
) -> tuple[OverallOutcome, str]:
    """The outcome of the run, worst first, and one sentence for it."""
    record = samples.record
    if record.status == "invalid":
        return "invalid", record.reason or "The run is invalid."
    if record.status == "incomplete":
        return "incomplete", record.reason or "The run was cut short."
    if policy.smoke and not requirements:
        # A busy machine, on which the playback is late, does not matter either.
        return "pass", _SMOKE_REASON
    if unusable:
        rate_hz, why = unusable[0].offered_hz, unusable[0].reason
        return "invalid", f"At {show(rate_hz, 'Hz')}: {why}" if rate_hz else why
    return outcome_of(requirements, policy.inconclusive, samples.starts)
