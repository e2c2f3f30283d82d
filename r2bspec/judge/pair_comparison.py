"""Judges a comparison of interleaved runs: requirements of the baseline, and all others.

Requirements of the baseline are judged by the pairs (`r2bspec.judge.baseline_ratio`); all others by
the runs of the head, as if they were one run with so many iterations. A rate is sustained if every
run of the head shows it, and is not if every run shows that. A peak lies in the bracket that
contains those of all runs.

Pairs that cannot be judged, because the playback missed its schedule, are played again once and
dropped if that does not help. With fewer than half of the planned pairs the comparison is INVALID.
The pairs as they were first played decide; `r2bspec.judge.pair_interference` has what host
interference does to a verdict on them.

A FAIL is confirmed by as many new pairs (`r2bspec.judge.confirmation`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import msgspec

from r2bspec.judge.affected_iterations import find_affected_iterations
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
from r2bspec.judge.outcome import outcome_of
from r2bspec.judge.pair_interference import (
    InterleavedRuns,
    examined_failure,
    examined_pass,
    taken_shares,
    without_excess,
)
from r2bspec.judge.playback_validity import PlaybackValidity
from r2bspec.judge.verdict import EXIT_CODES, Outcome, RequirementVerdict, Verdict
from r2bspec.language.confidence import CONFIRMATION_CONFIDENCE
from r2bspec.language.spec import Objective
from r2bspec.measure.samples import RunSamples
from r2bspec.record.comparison_folder import Side

Objectives = Mapping[str, Objective]

_EXPLAINED_BY: Final[Mapping[str, Side]] = {"fail": "head", "pass": "base"}
"""The side whose excess of host interference explains a verdict."""

_CONFIRMED = "Confirmed by new pairs."
_NO_NEW_PAIRS = "No new pairs were played to confirm it."
_NOT_COUNTED = "With 'gate.confirm: false' the new pairs do not count."
_NOT_CONFIRMED = "It had failed, but new pairs did not confirm the failure."


@dataclass(frozen=True)
class PairSet:
    """The pairs that were played to reach one verdict.

    Attributes:
        played: each as it was first played in a way that can be judged.
        unaffected: those without host interference; None if there was none in any.
        disturbance_text: which pairs were affected, and by what.
        planned: the planned number of pairs.
    """

    played: InterleavedRuns
    planned: int
    unaffected: InterleavedRuns | None = None
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
    if again is None or not policy.confirm:
        sentence = _NO_NEW_PAIRS if again is None else _NOT_COUNTED
        return msgspec.structs.replace(verdict, reason=f"{verdict.reason} {sentence}")
    new_objectives, new_policy = confirmation_terms(objectives, policy)
    found = confirm_run(
        verdict, judge_pair_set(new_objectives, again, new_policy), policy.inconclusive
    )
    sentence = _CONFIRMED if needs_confirmation(found) else _NOT_CONFIRMED
    return msgspec.structs.replace(found, reason=f"{found.reason} {sentence}")


def confirmation_terms(
    objectives: Objectives, policy: DecisionPolicy
) -> tuple[Objectives, DecisionPolicy]:
    """Objectives and policy by which the pairs that confirm a failure are judged."""
    at_policy_confidence = {
        name: msgspec.structs.replace(objective, confidence=None)
        for name, objective in objectives.items()
    }
    return at_policy_confidence, replace(policy, confidence=CONFIRMATION_CONFIDENCE)


def judge_pair_set(objectives: Objectives, pair_set: PairSet, policy: DecisionPolicy) -> Verdict:
    """Judge the pairs of one session, without confirmation.

    The number of pairs is fixed beforehand: there are no interim looks.
    """
    policy = replace(policy, looks=None)
    verdict = _judge(objectives, pair_set.played, policy)
    if policy.interference != "tolerate" and pair_set.unaffected is not None:
        requirements = _examine_pairs(verdict, objectives, pair_set, pair_set.unaffected, policy)
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


def reruns_can_decide(
    verdict: Verdict, objectives: Objectives, pair_set: PairSet, policy: DecisionPolicy
) -> bool:
    """Whether playing the affected pairs again can change the outcome of a session.

    It cannot where no requirement on pairs was opened because of interference, or where the outcome
    would be the same if none of them had been.

    Args:
        verdict: on the session, by `judge_pair_set`.
        objectives: that were judged.
        pair_set: of the session.
        policy: by which it was judged.
    """
    opened = [one.weakened and _is_on_pairs(one) for one in verdict.requirements]
    if verdict.outcome in {"invalid", "incomplete"} or not any(opened):
        return False
    as_played = _judge(objectives, pair_set.played, replace(policy, looks=None)).requirements
    requirements = [
        played if was_opened else one
        for one, played, was_opened in zip(verdict.requirements, as_played, opened, strict=True)
    ]
    return outcome_of(requirements, policy.inconclusive)[0] != verdict.outcome


def _is_on_pairs(one: RequirementVerdict) -> bool:
    """Whether pairs decided; all others rest on the head alone, and `judge` has examined them."""
    return one.method == "paired t on logs"


def _examine_pairs(
    verdict: Verdict,
    objectives: Objectives,
    pair_set: PairSet,
    unaffected: InterleavedRuns,
    policy: DecisionPolicy,
) -> tuple[RequirementVerdict, ...]:
    """The requirements of a verdict on all pairs, with regard to host interference."""
    decided = {one.outcome for one in verdict.requirements if _is_on_pairs(one)}
    if not decided & {"pass", "fail"}:
        return verdict.requirements
    text = pair_set.disturbance_text
    calm = _judge(objectives, unaffected, policy).requirements
    # Interference makes a side worse: more on the head's explains a FAIL, on the base's a PASS.
    without: dict[str, Sequence[RequirementVerdict]] = {
        outcome: _judge(objectives, without_excess(pair_set.played, side), policy).requirements
        for outcome, side in _EXPLAINED_BY.items()
        if outcome in decided
    }
    requirements = []
    for place, one in enumerate(verdict.requirements):
        if not _is_on_pairs(one) or one.outcome == "inconclusive":
            requirements.append(one)
            continue
        taken = taken_shares(pair_set.played, _EXPLAINED_BY[one.outcome], one.at_hz)
        examine = examined_failure if one.outcome == "fail" else examined_pass
        found = examine(one, calm[place], without[one.outcome][place], taken, text)
        requirements.append(_strict_pairs(found, calm[place], pair_set, policy))
    return tuple(requirements)


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
        remedy=one.remedy if outcome == "inconclusive" else "",
    )


def why_unusable(samples: RunSamples) -> str:
    """Why a run of a pair cannot be judged, in a sentence; empty if it can."""
    missed = PlaybackValidity.of(samples).iterations
    return next(iter(missed.values()), "")


def interference_text(samples: RunSamples) -> str:
    """The host interference in the iterations of a run, in words; empty for none."""
    found = [reason for one in find_affected_iterations(samples).values() for reason in one.reasons]
    return "; ".join(dict.fromkeys(found))
