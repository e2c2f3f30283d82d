"""Judges a comparison of interleaved runs: requirements of the baseline, and all others.

Requirements of the baseline are judged by the pairs (`r2bspec.judge.baseline_ratio`); all others by
the runs of the head, as if they were one run with so many iterations. A rate is sustained if every
run of the head shows it, and is not if every run shows that. A peak lies in the bracket that
contains those of all runs.

Pairs that cannot be judged, because the playback missed its schedule, are played again once and
dropped if that does not help. With fewer than half of the planned pairs the comparison is INVALID.
The pairs as they were first played decide. A FAIL is confirmed by as many new pairs
(`r2bspec.judge.confirmation`).

Of host interference only a difference between the sides counts. Interference makes a single run
doubtful. Interference that base and head had alike is no difference between them, and where it was
not quite alike by chance, the test on the pairs has accounted for that: it made the pairs differ.
So a verdict on pairs is opened only where more was taken from one side than from the other, and
where that can explain it.

Of each run the record has the share w of the time that others can have taken from it
(`r2bspec.judge.measure.host_usage.taken_share`). A run that needs more of the processor waits
longer under the same load, and this is its own affair. So in pair i, with the processor time u per
time that the runs used themselves, the excess of the head is

    e_i = w_head - w_base max(1, u_head / u_base)

and that of the base likewise. A side has an excess if the lower bound of Student's t on the mean
e_i over all pairs is above 0 at 99 % confidence; otherwise the sides had it alike. (At 95 % the
load would seem uneven in one of seven comparisons with new pairs, though it was not.)

A FAIL stays if the unaffected pairs fail, too, or if the head has no excess; a PASS likewise with
the base. Otherwise it becomes INCONCLUSIVE. Under ``tolerate`` nothing is examined.

On a busy machine latencies scatter so much that no number of starts decides them, while work does
not (`r2bspec.judge.turn_comparison`). So where other programs affected at least half of the starts
of both sides, a latency of the baseline by turns that is not decided is left open if the work at
its rate passes: reports say so, and the run can pass. A latency that fails counts as everywhere.
Under ``tolerate``, and where open requirements count as failed, nothing is left open.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import msgspec

from r2bspec.judge.affected_iterations import REMEDY, find_affected_iterations
from r2bspec.judge.baseline_comparison import judge_baseline_requirements, run_value
from r2bspec.judge.baseline_ratio import BaselineCase, judge_by_turns, judge_pairs
from r2bspec.judge.confirmation import confirm_run, needs_confirmation
from r2bspec.judge.decision_policy import DecisionPolicy, combine_looks, without_own_confidence
from r2bspec.judge.measure.host_usage import taken_share
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.measure.units import show
from r2bspec.judge.pipeline import first_iterations, judge
from r2bspec.judge.statistics.t_interval import mean_interval
from r2bspec.judge.turn_comparison import can_be_played_by_turns, turn_values
from r2bspec.judge.unmet import FAIL_FROM_STARTS, early_doubt_of_pairs
from r2bspec.judge.validity import PlaybackValidity
from r2bspec.judge.verdict import EXIT_CODES, Outcome, RequirementVerdict, Verdict, outcome_of
from r2bspec.language.benchmark_defaults import CONFIRMATION_CONFIDENCE
from r2bspec.language.quantities import Share
from r2bspec.language.spec import Objective
from r2bspec.plan.interim_looks import InterimLooks
from r2bspec.record.comparison_folder import Side

EXCESS_CONFIDENCE: Final = 0.99
"""At which one side had more interference than the other."""


@dataclass(frozen=True)
class InterleavedRuns:
    """Some pairs, each a run of the base and one of the head, and the head's runs as one."""

    base: Sequence[RunSamples]
    head: Sequence[RunSamples]
    merged: RunSamples

    def first(self, number: int) -> InterleavedRuns:
        """The first pairs; each is one iteration of the merged run at each rate."""
        merged = first_iterations(self.merged, number)
        return InterleavedRuns(self.base[:number], self.head[:number], merged)

    def each_with_other(self, side: Side) -> Iterator[tuple[RunSamples, RunSamples]]:
        """The run of one side and that of the other, of each pair."""
        runs = (self.base, self.head) if side == "base" else (self.head, self.base)
        return zip(*runs, strict=True)


@dataclass(frozen=True)
class TakenShares:
    """The mean share of the time that others can have taken from either side at a rate.

    Attributes:
        excess: the lower bound of the mean excess of the side that was asked about; 0 or less if
            the sides had it alike.
    """

    base: float
    head: float
    excess: float

    @property
    def text(self) -> str:
        """Both shares, as a part of a sentence."""
        return (
            f"{show(self.head, 'share')} of the time from the head, "
            f"{show(self.base, 'share')} from the base"
        )


def taken_shares(
    pairs: InterleavedRuns, side: Side, at_hz: float | None, confidence: float = EXCESS_CONFIDENCE
) -> TakenShares:
    """What others can have taken from both sides, and whether `side` has an excess."""
    base, head = ([_taken(run, at_hz) for run in runs] for runs in (pairs.base, pairs.head))
    excesses = [pair_excess(run, other, at_hz) for run, other in pairs.each_with_other(side)]
    excess = mean_interval(excesses, confidence).lower if len(excesses) > 1 else 0.0
    number = max(1, len(excesses))
    return TakenShares(math.fsum(base) / number, math.fsum(head) / number, excess)


def pair_excess(one: RunSamples, other: RunSamples, at_hz: float | None) -> float:
    """The share taken from `one` beyond what the load that `other` met would have taken from it."""
    own, others = _own_cores(one, at_hz), _own_cores(other, at_hz)
    longer = max(1.0, own / others) if own and others else 1.0
    return _taken(one, at_hz) - longer * _taken(other, at_hz)


def _examined(
    judged: RequirementVerdict,
    unaffected: RequirementVerdict,
    taken: TakenShares,
    disturbance_text: str,
) -> RequirementVerdict:
    """Return a decision on pairs of which some were affected by host interference.

    Args:
        judged: the verdict on all pairs as they were played.
        unaffected: that on the unaffected pairs.
        taken: from both sides, with the excess that would explain the decision.
        disturbance_text: which pairs were affected, as a sentence without its full stop.
    """
    if unaffected.outcome != judged.outcome and taken.excess > 0:
        return judged.opened(
            f"{disturbance_text}. The {_EXPLAINED_BY[judged.outcome]} had more of it "
            f"({taken.text}), and the unaffected pairs alone do not decide it.",
            REMEDY,
        )
    if judged.outcome != "fail":
        return judged
    if unaffected.outcome == "fail":
        return judged.noted(f"{disturbance_text}. The unaffected pairs fail, too.")
    return judged.noted(
        f"{disturbance_text}. Base and head had it alike ({taken.text}), so that it does not "
        "explain the difference."
    )


def _taken(run: RunSamples, at_hz: float | None) -> float:
    """The share of the time that others can have taken from a run at a rate, in the mean."""
    return _mean([taken_share(iteration.interference) for iteration in run.iterations_at(at_hz)])


def _own_cores(run: RunSamples, at_hz: float | None) -> float:
    """The processor time per time that a run used at a rate; 0 if it is not known."""
    return _mean(
        [
            (iteration.interference.own_cores if iteration.interference else None) or 0.0
            for iteration in run.iterations_at(at_hz)
        ]
    )


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values) if values else 0.0


Objectives = Mapping[str, Objective]

_EXPLAINED_BY: Final[Mapping[str, Side]] = {"fail": "head", "pass": "base"}
"""The side whose excess of host interference explains a verdict."""

_CONFIRMED = "Confirmed by new pairs."
_CONFIRMED_BY = "Confirmed by {} more starts of both sides."
_NOT_CONFIRMED_BY = "It had failed, but does not with {} more starts of both sides."
_NO_NEW_PAIRS = "No new pairs were played to confirm it."
_NOT_COUNTED = "With 'gate.confirm: false' the new pairs do not count."
_NOT_CONFIRMED = "It had failed, but new pairs did not confirm the failure."


@dataclass(frozen=True)
class PairSet:
    """The pairs that were played to reach one verdict.

    Attributes:
        played: each as it was first played in a way that can be judged.
        tried: how many were played, whether they can be judged or not.
        looks: the planned looks after each pair; None where all are judged at once.
        unaffected: those without host interference; None if there was none in any.
        disturbance_text: which pairs were affected, and by what.
        fresh_starts: of both sides, at the end, that were played to confirm a failure.
    """

    played: InterleavedRuns
    tried: int
    looks: InterimLooks | None = None
    unaffected: InterleavedRuns | None = None
    disturbance_text: str = ""
    fresh_starts: int = 0


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
    if first.fresh_starts:
        held = needs_confirmation(verdict)
        return verdict.saying(
            (_CONFIRMED_BY if held else _NOT_CONFIRMED_BY).format(first.fresh_starts)
        )
    if not needs_confirmation(verdict):
        return verdict
    if again is None or not policy.confirm:
        return verdict.saying(_NO_NEW_PAIRS if again is None else _NOT_COUNTED)
    new_objectives, new_policy = confirmation_terms(objectives, policy)
    run_verdict = confirm_run(
        verdict, judge_pair_set(new_objectives, again, new_policy), policy.inconclusive
    )
    return run_verdict.saying(_CONFIRMED if needs_confirmation(run_verdict) else _NOT_CONFIRMED)


def confirmation_terms(
    objectives: Objectives, policy: DecisionPolicy
) -> tuple[Objectives, DecisionPolicy]:
    """Objectives and policy by which the pairs that confirm a failure are judged."""
    return without_own_confidence(objectives), replace(policy, confidence=CONFIRMATION_CONFIDENCE)


def judge_pair_set(objectives: Objectives, pair_set: PairSet, policy: DecisionPolicy) -> Verdict:
    """Judge the pairs of one session, without confirmation.

    Args:
        objectives: of the head, by name.
        pair_set: the pairs, and when they are judged.
        policy: of the head's plan; its looks are those at a run.
    """
    policy = replace(policy, looks=pair_set.looks)
    verdict = _judge(objectives, pair_set.played, policy)
    if policy.interference != "tolerate" and pair_set.unaffected is not None:
        requirements = _examine_pairs(verdict, objectives, pair_set, pair_set.unaffected, policy)
        verdict = verdict.with_requirements(requirements, policy.inconclusive)
    merged = pair_set.played.merged
    played = sum(len(iterations) for iterations in merged.iterations.values())
    verdict = leave_latencies_open(verdict, played, policy)
    usable = len(pair_set.played.head)
    if verdict.outcome != "incomplete" and 2 * usable < pair_set.tried:
        return msgspec.structs.replace(
            verdict,
            outcome="invalid",
            exit_code=EXIT_CODES["invalid"],
            reason=f"Only {usable} of {pair_set.tried} pairs can be judged.",
        )
    return verdict


_BY_TURNS: Final = "trimmed t by turns"


def leave_latencies_open(verdict: Verdict, played: int, policy: DecisionPolicy) -> Verdict:
    """Return the verdict, with latencies left open on a busy machine whose work is decided.

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
    opened = [
        requirement.weakened and _is_on_pairs(requirement) for requirement in verdict.requirements
    ]
    if not verdict.is_judged or not any(opened):
        return False
    policy = replace(policy, looks=pair_set.looks)
    as_played = _judge(objectives, pair_set.played, policy).requirements
    requirements = [
        played if was_opened else requirement
        for requirement, played, was_opened in zip(
            verdict.requirements, as_played, opened, strict=True
        )
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
    decided = {
        pair_verdict.outcome for pair_verdict in verdict.requirements if _is_on_pairs(pair_verdict)
    }
    if not decided & {"pass", "fail"}:
        return verdict.requirements
    # That they are fewer ends no comparison.
    calm = _judge(objectives, unaffected, replace(policy, looks=None)).requirements
    requirements = []
    for place, requirement in enumerate(verdict.requirements):
        if _is_on_pairs(requirement) and requirement.outcome != "inconclusive":
            side = _EXPLAINED_BY[requirement.outcome]
            taken = taken_shares(pair_set.played, side, requirement.at_hz)
            requirement = _examined(requirement, calm[place], taken, pair_set.disturbance_text)
        requirements.append(requirement)
    return tuple(requirements)


def _judge(objectives: Objectives, pairs: InterleavedRuns, policy: DecisionPolicy) -> Verdict:
    """The verdict after all looks that so many pairs allow."""
    looks = policy.looks
    if looks is None:
        return _judge_once(objectives, pairs, policy)
    completed = looks.iterations[: max(1, looks.completed_looks(len(pairs.head)))]
    planned = looks.iterations[-1]
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
            early=end < planned,
        )
        for look, end in enumerate(completed, start=1)
    ]
    columns = zip(*(verdict.requirements for verdict in verdicts), strict=True)
    requirements = tuple(combine_looks(looks, column) for column in columns)
    return verdicts[-1].with_requirements(requirements, policy.inconclusive)


def _at_look(objective: Objective, looks: InterimLooks, look: int) -> Objective:
    """An objective with its own confidence, if it has one, at a look."""
    own = objective.confidence
    if own is None:
        return objective
    return msgspec.structs.replace(
        objective, confidence=Share(looks.confidence_at(look, own.fraction))
    )


def _judge_once(
    objectives: Objectives,
    pairs: InterleavedRuns,
    policy: DecisionPolicy,
    *,
    early: bool = False,
) -> Verdict:
    """The verdict on so many pairs; `early` if more pairs are planned."""
    verdict = judge(objectives, pairs.merged, policy)
    verdict = judge_baseline_requirements(
        verdict,
        objectives,
        pairs.merged,
        policy,
        lambda case: _judge_by_pairs(case, pairs, early=early),
    )
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


def _judge_by_pairs(
    case: BaselineCase, pairs: InterleavedRuns, *, early: bool
) -> RequirementVerdict:
    if can_be_played_by_turns(case.info) and _by_turns(pairs, case.at_hz):
        values = [
            turn_values(case.info, case.monitor, case.at_hz, before, after)
            for before, after in zip(pairs.base, pairs.head, strict=True)
        ]
        return judge_by_turns(case, [base for base, _ in values], [head for _, head in values])
    base, head = (
        [run_value(case.info, case.monitor, case.at_hz, run) for run in side]
        for side in (pairs.base, pairs.head)
    )
    verdict = judge_pairs(case, base, head)
    if not early or verdict.outcome == "inconclusive":
        return verdict
    merged = replace(case, iterations=pairs.merged.iterations_at(case.at_hz))
    messages = 0
    if case.monitor is not None and case.info.metric.has_percentiles:
        messages = sum(values.size for values in merged.message_values)
    doubt = early_doubt_of_pairs(case, verdict, messages)
    return verdict.held_back(doubt, opens=verdict.n < FAIL_FROM_STARTS)


def _by_turns(pairs: InterleavedRuns, at_hz: float | None) -> bool:
    """Whether both sides were played by turns at a rate in every start of both."""
    runs = [*pairs.base, *pairs.head]
    return bool(runs) and all(run.turns_at(at_hz) is not None for run in runs)


def _combine_sustained(found: Sequence[RequirementVerdict]) -> RequirementVerdict:
    """The combined verdict of the probes of all runs of the head."""
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
    """Why a run of a pair cannot be judged, in a sentence; empty if it can."""
    invalid = PlaybackValidity.of(samples).iterations.values()
    return next((problem.reason for problem in invalid), "")


def interference_text(samples: RunSamples) -> str:
    """The host interference in the iterations of a run, in words; empty for none."""
    reasons = [
        reason
        for affected_iteration in find_affected_iterations(samples).values()
        for reason in affected_iteration.reasons
    ]
    return "; ".join(dict.fromkeys(reasons))
