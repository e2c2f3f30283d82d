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

No verdict becomes a PASS.
"""

from __future__ import annotations

import msgspec

from r2bspec.judge.verdict import InconclusivePolicy, RequirementVerdict, Verdict

_REMEDY = "Run again; if the failure is intermittent, look for what differs between the runs."


def needs_confirmation(verdict: Verdict) -> bool:
    """Return True if a verdict is a FAIL that a second session has to confirm."""
    return verdict.outcome == "fail" and any(
        requirement.fails_run for requirement in verdict.requirements
    )


def confirm_requirement(
    first: RequirementVerdict, second: RequirementVerdict | None
) -> RequirementVerdict:
    """Combine the verdicts on a requirement of both sessions.

    Args:
        first: its verdict on the first session.
        second: its verdict on the second session at `CONFIRMATION_CONFIDENCE`; None without one.
    """
    if first.outcome != "fail":
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
    """Combine the verdicts on a run of both sessions.

    A second session that is invalid or incomplete confirms nothing: its failures count as not
    judged.

    Args:
        first: the verdict on the first session, for which `needs_confirmation`.
        second: the verdict on the second, by the same objectives, with the confidence
            `CONFIRMATION_CONFIDENCE` and no interim looks.
        policy: what an inconclusive requirement does to the run.
    """
    again = second.by_key
    requirements = tuple(
        confirm_requirement(requirement, again.get(requirement.key))
        for requirement in first.requirements
    )
    return first.with_requirements(requirements, policy)


def _lower(text: str) -> str:
    """Return a sentence as the second part of another; names keep their case."""
    return text[:1].lower() + text[1:] if text[1:2].islower() else text
