"""Judges a comparison of pairs: requirements of the baseline, and all others.

A pair is a start of both sides by turns, or a run of the base and one of the head. Requirements of
the baseline are judged by the ratios of the pairs (`r2bspec.judge.ratio_of_starts`); all others by
the runs of the head, joined to one run. A rate is sustained if every run of the head shows that it
is, and not sustained if every run shows that it is not. A peak lies in the bracket that contains
those of all runs.

Pairs that cannot be judged, because the playback missed its schedule, are played again once and
dropped if that does not help. With fewer than half of the planned pairs the comparison is INVALID.
A FAIL is confirmed by more pairs in the same list: it stands if they do not mend it.

Host interference opens nothing here. A coin decides which side of a pair is first, so that other
programs meet either side by chance, and chance makes the pairs differ, which their test accounts
for.

On a busy machine latencies scatter so much that no number of starts decides them, while work does
not. So where other programs affected at least half of the starts of both sides, a latency of the
baseline by turns that is not decided is left open if the work at its rate passes: reports say so,
and the run can pass. A latency that fails counts as everywhere. Under ``tolerate``, and where open
requirements count as failed, nothing is left open.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import msgspec

from r2bspec.judge.confirmation import needs_confirmation
from r2bspec.judge.decision_policy import DecisionPolicy, combine_looks
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.pipeline import first_iterations, judge
from r2bspec.judge.ratio_of_starts import (
    can_be_played_by_turns,
    judge_ratio,
    run_value,
    turn_kind,
    turn_values,
)
from r2bspec.judge.requirement_case import RequirementCase
from r2bspec.judge.validity import PlaybackValidity
from r2bspec.judge.verdict import EXIT_CODES, Outcome, RequirementVerdict, Verdict
from r2bspec.language.quantities import Share
from r2bspec.language.spec import Objective
from r2bspec.plan.interim_looks import InterimLooks

Objectives = Mapping[str, Objective]


@dataclass(frozen=True)
class Pairs:
    """The pairs of a comparison that can be judged.

    Attributes:
        base: its runs.
        head: its runs.
        merged: those of the head as one.
        tried: how many pairs were played, whether they can be judged or not.
        looks: the planned looks; None where all are judged at once.
        confirms: what was played to confirm a failure, such as ``5 more pairs``; may be empty.
    """

    base: Sequence[RunSamples]
    head: Sequence[RunSamples]
    merged: RunSamples
    tried: int
    looks: InterimLooks | None = None
    confirms: str = ""

    def first(self, number: int) -> Pairs:
        """Return the first pairs; a pair is an iteration of the merged run at each rate."""
        merged = first_iterations(self.merged, number)
        return replace(self, base=self.base[:number], head=self.head[:number], merged=merged)


def judge_comparison(objectives: Objectives, pairs: Pairs, policy: DecisionPolicy) -> Verdict:
    """Judge a comparison, and say whether a failure was confirmed; a pure function.

    Args:
        objectives: the objectives of the head, by name.
        pairs: the pairs that were played.
        policy: the policy of the head's plan.
    """
    verdict = judge_pairs(objectives, pairs, policy)
    fails = needs_confirmation(verdict)
    if pairs.confirms:
        begins = "Confirmed by" if fails else "It had failed, but does not with"
        return verdict.saying(f"{begins} {pairs.confirms}.")
    return verdict.saying("No more pairs were played to confirm it.") if fails else verdict


def judge_pairs(objectives: Objectives, pairs: Pairs, policy: DecisionPolicy) -> Verdict:
    """Judge pairs, without a sentence on confirmation.

    Args:
        objectives: the objectives of the head, by name.
        pairs: the pairs that were played, and when they are judged.
        policy: the policy of the head's plan; its looks are those at a run.
    """
    verdict = _judge(objectives, pairs, replace(policy, looks=pairs.looks))
    played = sum(len(iterations) for iterations in pairs.merged.iterations.values())
    verdict = leave_latencies_open(verdict, played, policy)
    usable = len(pairs.head)
    if verdict.outcome != "incomplete" and 2 * usable < pairs.tried:
        return msgspec.structs.replace(
            verdict,
            outcome="invalid",
            exit_code=EXIT_CODES["invalid"],
            reason=f"Only {usable} of {pairs.tried} pairs can be judged.",
        )
    return verdict


_BY_TURNS: Final = "trimmed t by turns"


def leave_latencies_open(verdict: Verdict, played: int, policy: DecisionPolicy) -> Verdict:
    """Return the verdict without latencies that a busy machine left open if work is decided.

    Args:
        verdict: on starts of both sides by turns.
        played: the iterations of the head.
        policy: by which it was judged.
    """
    affected = {one.segment for one in verdict.disturbed if not one.rerun_of}
    is_strict = policy.interference == "tolerate" or policy.inconclusive == "fail"
    if is_strict or not affected or 2 * len(affected) < played:
        return verdict
    by_turns = [
        one for one in verdict.requirements if one.method == _BY_TURNS and one.level == "error"
    ]
    work = [one for one in by_turns if one.metric.startswith("work.")]
    requirements = tuple(
        msgspec.structs.replace(one, left_open=True, remedy="")
        if one in by_turns
        and one.outcome == "inconclusive"
        and one.metric.startswith("latency")
        and {other.outcome for other in work if other.at_hz == one.at_hz} == {"pass"}
        else one
        for one in verdict.requirements
    )
    return verdict.with_requirements(requirements, policy.inconclusive)


def _judge(objectives: Objectives, pairs: Pairs, policy: DecisionPolicy) -> Verdict:
    """Return the verdict after all looks that so many pairs allow."""
    looks = policy.looks
    if looks is None:
        return _judge_once(objectives, pairs, policy)
    completed = looks.iterations[: max(1, looks.completed_looks(len(pairs.head)))]
    verdicts = [
        _judge_once(
            {name: _at_look(objective, looks, look) for name, objective in objectives.items()},
            pairs.first(end),
            replace(
                policy,
                looks=None,
                early=end < looks.declared,
                confidence=looks.confidence_at(look, policy.confidence),
            ),
        )
        for look, end in enumerate(completed, start=1)
    ]
    columns = zip(*(verdict.requirements for verdict in verdicts), strict=True)
    requirements = tuple(combine_looks(looks, column) for column in columns)
    return verdicts[-1].with_requirements(requirements, policy.inconclusive)


def _at_look(objective: Objective, looks: InterimLooks, look: int) -> Objective:
    """Return an objective with its own confidence, if it has one, at a look."""
    own = objective.confidence
    if own is None:
        return objective
    return msgspec.structs.replace(
        objective, confidence=Share(looks.confidence_at(look, own.fraction))
    )


def _judge_once(objectives: Objectives, pairs: Pairs, policy: DecisionPolicy) -> Verdict:
    verdict = judge(objectives, pairs.merged, policy, lambda case: _judge_ratio(case, pairs))
    if not any(requirement.metric == "sustained" for requirement in verdict.requirements):
        return verdict
    by_run = [judge(objectives, run, policy).requirements for run in pairs.head]
    requirements = tuple(
        _combine_sustained([found[place] for found in by_run])
        if requirement.metric == "sustained" and by_run
        else requirement
        for place, requirement in enumerate(verdict.requirements)
    )
    return verdict.with_requirements(requirements, policy.inconclusive)


def _judge_ratio(case: RequirementCase, pairs: Pairs) -> RequirementVerdict:
    by_turns = can_be_played_by_turns(case.info) and _were_by_turns(pairs, case)
    asked = case.info, case.monitor, case.at_hz
    values = [
        turn_values(*asked, before, after)
        if by_turns
        else (run_value(*asked, before), run_value(*asked, after))
        for before, after in zip(pairs.base, pairs.head, strict=True)
    ]
    base, head = [before for before, _ in values], [after for _, after in values]
    return judge_ratio(case, base, head, by_turns=by_turns)


def _were_by_turns(pairs: Pairs, case: RequirementCase) -> bool:
    """Return whether both sides were played by turns for a requirement in every start of both."""
    kind, runs = turn_kind(case.info), [*pairs.base, *pairs.head]
    return bool(runs) and all(run.turns_at(kind, case.at_hz) is not None for run in runs)


def _combine_sustained(found: Sequence[RequirementVerdict]) -> RequirementVerdict:
    """Return the combined verdict of the probes of all runs of the head."""
    outcomes = [run_verdict.outcome for run_verdict in found]
    outcome: Outcome = outcomes[0] if len(set(outcomes)) == 1 else "inconclusive"
    counts = ", ".join(
        f"{outcomes.count(outcome_)} {what}"
        for outcome_, what in (
            ("pass", "passed"),
            ("fail", "failed"),
            ("inconclusive", "undecided"),
        )
        if outcome_ in outcomes
    )
    verdict = next(
        (run_verdict for run_verdict in found if run_verdict.outcome == outcome), found[0]
    )
    return msgspec.structs.replace(
        verdict,
        outcome=outcome,
        n=len(found),
        notes=(*verdict.notes, f"Probed in {len(found)} runs of the head: {counts}."),
        remedy=verdict.remedy if outcome == "inconclusive" else "",
    )


def why_unusable(samples: RunSamples) -> str:
    """Return why a run of a pair cannot be judged, in a sentence; empty if it can."""
    invalid = PlaybackValidity.of(samples).iterations.values()
    return next((problem.reason for problem in invalid), "")
