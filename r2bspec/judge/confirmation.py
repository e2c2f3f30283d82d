"""A FAIL is confirmed by a second session, in new processes, before it counts.

A gate of ten requirements that are each wrong once in twenty runs raises a false alarm every
other run. So a failed run is played once more, for as long as it took to fail, and its failed
requirements are judged on the new samples alone at `CONFIRMATION_CONFIDENCE`. With alpha the error
of the first session and beta = 1 - CONFIRMATION_CONFIDENCE that of the second, a requirement that
is met fails in at most

    alpha x beta = 5 % x 10 % = 0.5 %

of runs if the sessions are independent. The second confidence is lower on purpose: a true failure
has been found once, and only has to be found again in the same direction.

    first    second          combined
    fail     fail            FAIL, confirmed
    fail     inconclusive    INCONCLUSIVE: the failure was not reproduced
    fail     pass            INCONCLUSIVE: the two sessions contradict each other
    other    anything        as the first: what passed is not tried again

Messages that differ from the truth are not played again: they fail without a second session.

No verdict becomes a PASS.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from r2bspec.judge.decision_policy import DecisionPolicy, without_own_confidence
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.methods import METHODS
from r2bspec.judge.pipeline import judge
from r2bspec.judge.verdict import (
    InconclusivePolicy,
    InterferencePolicy,
    RequirementVerdict,
    Verdict,
)
from r2bspec.language.benchmark_defaults import CONFIRMATION_CONFIDENCE
from r2bspec.language.spec import Objective

_CONFIRMED = "Confirmed by a second run in new processes."
_NOT_CONFIRMED = "It had failed, but a second run in new processes did not confirm the failure."
_NOT_PLAYED_AGAIN = "No second run was made to confirm it."
_NOT_COUNTED = "With 'gate.confirm: false' its second run does not count."

_REMEDY = "Run again; if the failure is intermittent, look for what differs between the runs."


def needs_confirmation(verdict: Verdict) -> bool:
    """Whether a verdict is a FAIL that has to be confirmed by a second session."""
    return verdict.outcome == "fail" and any(one.fails_run for one in verdict.requirements)


def judge_with_confirmation(
    objectives: Mapping[str, Objective], samples: RunSamples, policy: DecisionPolicy
) -> Verdict:
    """Judge a run and, if it fails, the confirmation session that was played after it.

    A pure function, like `judge`. The reason of a FAIL says whether it was confirmed; without a
    confirmation session the FAIL counts.

    Args:
        objectives: by name.
        samples: the run.
        policy: of the first session.
    """
    first = judge(objectives, samples, policy)
    can_be_repeated = any(
        one.fails_run and METHODS[one.method].rests_on != "truth" for one in first.requirements
    )
    if not needs_confirmation(first) or not can_be_repeated:
        return first
    if samples.confirmation is None:
        return first.saying(_NOT_PLAYED_AGAIN)
    if not policy.confirm:
        return first.saying(_NOT_COUNTED)
    second = judge_confirmation(objectives, samples.confirmation, first, policy.interference)
    found = confirm_run(first, second, policy.inconclusive)
    found = found.saying(_CONFIRMED if needs_confirmation(found) else _NOT_CONFIRMED)
    return msgspec.structs.replace(found, disturbed=(*first.disturbed, *second.disturbed))


def judge_confirmation(
    objectives: Mapping[str, Objective],
    confirmation: RunSamples,
    first: Verdict,
    interference: InterferencePolicy = "note",
) -> Verdict:
    """Judge the confirmation session on its own, at `CONFIRMATION_CONFIDENCE`.

    Args:
        objectives: by name.
        confirmation: the confirmation session.
        first: the verdict on the first session; only what failed there is judged again.
        interference: what host interference does to a verdict.
    """
    failed = {one.key for one in first.requirements if one.outcome == "fail"}
    policy = DecisionPolicy(confidence=CONFIRMATION_CONFIDENCE, interference=interference)
    found = judge(without_own_confidence(objectives), confirmation, policy)
    judged_again = tuple(one for one in found.requirements if one.key in failed)
    return msgspec.structs.replace(found, requirements=judged_again)


def confirm_requirement(
    first: RequirementVerdict, second: RequirementVerdict | None
) -> RequirementVerdict:
    """One requirement after both sessions.

    Args:
        first: its verdict on the first session.
        second: its verdict on the second session at `CONFIRMATION_CONFIDENCE`; None without one.
    """
    if first.outcome != "fail" or METHODS[first.method].rests_on == "truth":
        return first
    if second is not None and second.outcome == "fail":
        return first.noted(f"Confirmed by a second run: {_lower(second.reason)}")
    if second is None:
        note = "The first run failed; a second run could not be judged."
    else:
        did = "passed" if second.outcome == "pass" else "was inconclusive"
        note = f"The first run failed, a second run {did}: {_lower(second.reason)}"
    return msgspec.structs.replace(first.noted(note), outcome="inconclusive", remedy=_REMEDY)


def confirm_run(first: Verdict, second: Verdict, policy: InconclusivePolicy = "report") -> Verdict:
    """A run after both sessions.

    A second session that is invalid or incomplete confirms nothing: its failures count as not
    judged.

    Args:
        first: the verdict on the first session, for which `needs_confirmation`.
        second: the verdict on the second, by the same objectives, with the confidence
            `CONFIRMATION_CONFIDENCE` and no interim looks.
        policy: what an inconclusive requirement does to the run.
    """
    again = {one.key: one for one in second.requirements} if second.is_judged else {}
    requirements = tuple(confirm_requirement(one, again.get(one.key)) for one in first.requirements)
    return first.with_requirements(requirements, policy)


def _lower(text: str) -> str:
    """A sentence as the second part of another; names keep their case."""
    return text[:1].lower() + text[1:] if text[1:2].islower() else text
