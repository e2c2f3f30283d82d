"""A FAIL is confirmed by a fresh batch in fresh processes before it counts.

A gate of ten requirements that are each wrong once in twenty runs cries wolf every other day. So a
failed run is played once more, as long as it was when it failed, and its failed requirements are
judged on the new samples alone at `CONFIRMATION_CONFIDENCE`. With alpha the error of the first
batch and beta = 1 - CONFIRMATION_CONFIDENCE that of the second, a requirement that holds fails in
at most

    alpha x beta = 5 % x 10 % = 0.5 %

of runs if the batches are independent. The second level is the weaker one on purpose: a true
failure was found once, and must now only be found in the same direction.

    first    second          together
    fail     fail            FAIL, confirmed
    fail     inconclusive    INCONCLUSIVE: a failure that did not show again
    fail     pass            INCONCLUSIVE: two batches that contradict each other
    other    anything        as the first: what passed is not tried again

Nothing becomes a PASS.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import msgspec

from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.judge_samples import judge
from r2bspec.judge.outcome import InconclusivePolicy, outcome_of
from r2bspec.judge.verdict import EXIT_CODES, RequirementVerdict, Verdict
from r2bspec.language.confidence import CONFIRMATION_CONFIDENCE
from r2bspec.language.spec import Objective
from r2bspec.measure.samples import RunSamples

_CONFIRMED = "A fresh batch in fresh processes confirmed it."
_NOT_CONFIRMED = "It had failed, and a fresh batch in fresh processes did not confirm that."
_NOT_PLAYED_AGAIN = "No fresh batch was played to confirm it."

_SETTLE = "Run again; if it comes and goes, look for what differs between the runs."


def needs_confirmation(verdict: Verdict) -> bool:
    """Whether a verdict is a FAIL that a fresh batch has to confirm."""
    return verdict.outcome == "fail" and any(
        one.outcome == "fail" and one.level == "error" for one in verdict.requirements
    )


def judge_with_confirmation(
    objectives: Mapping[str, Objective], samples: RunSamples, policy: DecisionPolicy
) -> Verdict:
    """Judge a run and, if it fails, the fresh batch that was played after it.

    A pure function, like `judge`. A FAIL says in its reason whether it was confirmed; it stands
    where no fresh batch was played.

    Args:
        objectives: by name.
        samples: the run.
        policy: of the first batch.
    """
    first = judge(objectives, samples, policy)
    if not needs_confirmation(first):
        return first
    if samples.confirmation is None:
        return msgspec.structs.replace(first, reason=f"{first.reason} {_NOT_PLAYED_AGAIN}")
    second = judge_confirmation(objectives, samples.confirmation, first)
    found = confirm_run(first, second, policy.inconclusive)
    said = _CONFIRMED if needs_confirmation(found) else _NOT_CONFIRMED
    return msgspec.structs.replace(
        found,
        reason=f"{found.reason} {said}",
        disturbed=(*first.disturbed, *second.disturbed),
    )


def judge_confirmation(
    objectives: Mapping[str, Objective], confirmation: RunSamples, first: Verdict
) -> Verdict:
    """Judge the batch that confirms, on its own and at `CONFIRMATION_CONFIDENCE`.

    Args:
        objectives: by name.
        confirmation: the fresh batch.
        first: the verdict on the first batch; what did not fail there is not asked again.
    """
    failed = {_key(one) for one in first.requirements if one.outcome == "fail"}
    again = {
        name: msgspec.structs.replace(objective, confidence=None)
        for name, objective in objectives.items()
    }
    found = judge(again, confirmation, DecisionPolicy(confidence=CONFIRMATION_CONFIDENCE))
    asked = tuple(one for one in found.requirements if _key(one) in failed)
    return msgspec.structs.replace(found, requirements=asked)


def confirm_requirement(
    first: RequirementVerdict, second: RequirementVerdict | None
) -> RequirementVerdict:
    """One requirement after both batches.

    Args:
        first: its verdict on the first batch.
        second: its verdict on the second batch at `CONFIRMATION_CONFIDENCE`; None if that had none.
    """
    if first.outcome != "fail":
        return first
    if second is not None and second.outcome == "fail":
        note = f"Confirmed by a fresh batch: {_lower(second.reason)}"
        return msgspec.structs.replace(first, notes=(*first.notes, note))
    if second is None:
        note = "The first batch failed; a fresh batch could not be judged."
    else:
        did = "passed" if second.outcome == "pass" else "could not tell"
        note = f"The first batch failed, a fresh one {did}: {_lower(second.reason)}"
    return msgspec.structs.replace(
        first, outcome="inconclusive", settle=_SETTLE, notes=(*first.notes, note)
    )


def confirm_run(first: Verdict, second: Verdict, policy: InconclusivePolicy = "report") -> Verdict:
    """A run after both batches.

    A second batch that is invalid or incomplete confirms nothing: its failures count as not
    judged.

    Args:
        first: the verdict on the first batch, for which `needs_confirmation`.
        second: the verdict on the second, by the same objectives, with the confidence
            `CONFIRMATION_CONFIDENCE` and no looks.
        policy: what an inconclusive requirement does to the run.
    """
    usable: Iterable[RequirementVerdict] = second.requirements
    if second.outcome in {"invalid", "incomplete"}:
        usable = ()
    found = {_key(one): one for one in usable}
    requirements = tuple(
        confirm_requirement(one, found.get(_key(one))) for one in first.requirements
    )
    outcome, reason = outcome_of(requirements, policy)
    return msgspec.structs.replace(
        first,
        outcome=outcome,
        exit_code=EXIT_CODES[outcome],
        reason=reason,
        requirements=requirements,
    )


def _key(one: RequirementVerdict) -> tuple[str, str, str | None, float | None]:
    return one.objective, one.text, one.monitor, one.at_hz


def _lower(text: str) -> str:
    """A sentence as the second half of another; names keep their case."""
    return text[:1].lower() + text[1:] if text[1:2].islower() else text
