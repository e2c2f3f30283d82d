"""Judges a comparison of interleaved runs: requirements of the baseline, and all others.

Requirements of the baseline are judged by the pairs (`r2bspec.judge.baseline_ratio`); all others by
the runs of the head, as if they were one run with so many iterations. A rate is sustained if every
run of the head shows it, and is not if every run shows that. A peak lies in the bracket that
contains those of all runs.

Pairs that cannot be judged, because the playback missed its schedule, are played again once and
dropped if that does not help. With fewer than half of the planned pairs the comparison is INVALID.
Host interference has the same effect as in a single run (`r2bspec.judge.affected_iterations`): the
pairs as they were first played decide. A FAIL becomes INCONCLUSIVE unless the unaffected pairs,
those played again among them, fail as well, or all pairs do with the best case of the head's
affected iterations and the base as it was.

A FAIL is confirmed by as many new pairs (`r2bspec.judge.confirmation`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import msgspec

from r2bspec.judge.affected_iterations import (
    best_case_run,
    find_affected_iterations,
    weaken_failure,
)
from r2bspec.judge.baseline_ratio import judge_pairs
from r2bspec.judge.baseline_requirements import (
    BaselineQuestion,
    judge_baseline_requirements,
    run_value,
    with_requirement_verdicts,
)
from r2bspec.judge.confirmation import confirm_run, needs_confirmation
from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.interference_policy import strict_refusal
from r2bspec.judge.judge_samples import judge
from r2bspec.judge.playback_validity import PlaybackValidity
from r2bspec.judge.verdict import EXIT_CODES, Outcome, RequirementVerdict, Verdict
from r2bspec.language.confidence import CONFIRMATION_CONFIDENCE
from r2bspec.language.spec import Objective
from r2bspec.measure.samples import RunSamples

Objectives = Mapping[str, Objective]

_CONFIRMED = "Confirmed by new pairs."
_NOT_CONFIRMED = "It had failed, but new pairs did not confirm the failure."


@dataclass(frozen=True)
class InterleavedRuns:
    """Some pairs, each a run of the base and one of the head, and the head's runs as one."""

    base: Sequence[RunSamples]
    head: Sequence[RunSamples]
    merged: RunSamples


@dataclass(frozen=True)
class PairSet:
    """The pairs that were played to reach one verdict.

    Attributes:
        played: each as it was first played in a way that can be judged.
        unaffected: those without host interference; None if there was none in any.
        best_case: all of them, with the best case of the head's affected iterations; likewise.
        disturbance_text: which pairs were affected, and by what.
        planned: the planned number of pairs.
    """

    played: InterleavedRuns
    planned: int
    unaffected: InterleavedRuns | None = None
    best_case: InterleavedRuns | None = None
    disturbance_text: str = ""


def judge_comparison(
    objectives: Objectives, first: PairSet, again: PairSet | None, policy: DecisionPolicy
) -> Verdict:
    """Judge a comparison. A pure function of its arguments.

    Args:
        objectives: of the head, by name.
        first: the pairs.
        again: the new pairs that were played after a failure, if there were any.
        policy: of the head's plan.
    """
    verdict = judge_pair_set(objectives, first, policy)
    if not needs_confirmation(verdict):
        return verdict
    if again is None:
        return msgspec.structs.replace(
            verdict, reason=f"{verdict.reason} No new pairs were played to confirm it."
        )
    at_policy_confidence = {
        name: msgspec.structs.replace(objective, confidence=None)
        for name, objective in objectives.items()
    }
    found = confirm_run(
        verdict,
        judge_pair_set(
            at_policy_confidence, again, replace(policy, confidence=CONFIRMATION_CONFIDENCE)
        ),
        policy.inconclusive,
    )
    sentence = _CONFIRMED if needs_confirmation(found) else _NOT_CONFIRMED
    return msgspec.structs.replace(found, reason=f"{found.reason} {sentence}")


def judge_pair_set(objectives: Objectives, pair_set: PairSet, policy: DecisionPolicy) -> Verdict:
    """Judge the pairs of one session, without confirmation.

    The number of pairs is fixed beforehand: there are no interim looks.
    """
    policy = replace(policy, looks=None)
    verdict = _judge(objectives, pair_set.played, policy)
    examined = policy.interference != "tolerate"
    if examined and pair_set.unaffected is not None and pair_set.best_case is not None:
        unaffected = _judge(objectives, pair_set.unaffected, policy).requirements
        best_case = _judge(objectives, pair_set.best_case, policy).requirements
        requirements = tuple(
            # All others are based on the iterations of the head, which `judge` has treated alike.
            _strict_pairs(
                weaken_failure(one, other, pair_set.disturbance_text, most), other, pair_set, policy
            )
            if one.method == "paired t on logs"
            else one
            for one, other, most in zip(verdict.requirements, unaffected, best_case, strict=True)
        )
        if verdict.outcome in {"invalid", "incomplete"}:
            verdict = msgspec.structs.replace(verdict, requirements=requirements)
        else:
            verdict = with_requirement_verdicts(verdict, requirements, policy)
    usable = len(pair_set.played.head)
    if verdict.outcome != "incomplete" and 2 * usable < pair_set.planned:
        return msgspec.structs.replace(
            verdict,
            outcome="invalid",
            exit_code=EXIT_CODES["invalid"],
            reason=f"Only {usable} of {pair_set.planned} pairs can be judged.",
        )
    return verdict


def _strict_pairs(
    judged: RequirementVerdict,
    unaffected: RequirementVerdict,
    pair_set: PairSet,
    policy: DecisionPolicy,
) -> RequirementVerdict:
    """A verdict on pairs under ``strict``: a PASS needs an unaffected pair in place of each."""
    if policy.interference != "strict" or judged.outcome != "pass" or pair_set.unaffected is None:
        return judged
    whole = len(pair_set.unaffected.head) == len(pair_set.played.head)
    if whole and unaffected.outcome == "pass":
        return judged
    return strict_refusal(judged, pair_set.disturbance_text)


def _judge(objectives: Objectives, pairs: InterleavedRuns, policy: DecisionPolicy) -> Verdict:
    verdict = judge(objectives, pairs.merged, policy)
    verdict = judge_baseline_requirements(
        verdict, objectives, pairs.merged, policy, lambda question: _judge_by_pairs(question, pairs)
    )
    if not any(one.metric == "sustained" for one in verdict.requirements):
        return verdict
    each = [judge(objectives, run, policy).requirements for run in pairs.head]
    requirements = tuple(
        _combine_sustained([found[place] for found in each])
        if one.metric == "sustained" and each
        else one
        for place, one in enumerate(verdict.requirements)
    )
    if verdict.outcome in {"invalid", "incomplete"}:
        return msgspec.structs.replace(verdict, requirements=requirements)
    return with_requirement_verdicts(verdict, requirements, policy)


def _judge_by_pairs(question: BaselineQuestion, pairs: InterleavedRuns) -> RequirementVerdict:
    one = question.comparison
    base, head = (
        [run_value(question.info, one.monitor, one.at_hz, run) for run in side]
        for side in (pairs.base, pairs.head)
    )
    return judge_pairs(one, base, head)


def _combine_sustained(found: Sequence[RequirementVerdict]) -> RequirementVerdict:
    """The combined verdict of the probes of all runs of the head."""
    outcomes = [one.outcome for one in found]
    outcome: Outcome = outcomes[0] if len(set(outcomes)) == 1 else "inconclusive"
    counts = ", ".join(
        f"{outcomes.count(each)} {what}"
        for each, what in (("pass", "passed"), ("fail", "failed"), ("inconclusive", "undecided"))
        if each in outcomes
    )
    one = next((one for one in found if one.outcome == outcome), found[0])
    return msgspec.structs.replace(
        one,
        outcome=outcome,
        n=len(found),
        notes=(*one.notes, f"Probed in {len(found)} runs of the head: {counts}."),
        settle=one.settle if outcome == "inconclusive" else "",
    )


def best_case_runs(pairs: InterleavedRuns) -> InterleavedRuns:
    """Pairs with the best case of the head's affected iterations; the base is unchanged."""
    return replace(
        pairs, head=[best_case_run(run, find_affected_iterations(run)) for run in pairs.head]
    )


def why_unusable(samples: RunSamples) -> str:
    """Why a run of a pair cannot be judged, in a sentence; empty if it can."""
    missed = PlaybackValidity.of(samples).iterations
    return next(iter(missed.values()), "")


def interference_text(samples: RunSamples) -> str:
    """The host interference in the iterations of a run, in words; empty for none."""
    found = [reason for one in find_affected_iterations(samples).values() for reason in one.reasons]
    return "; ".join(dict.fromkeys(found))
