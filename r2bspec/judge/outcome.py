"""From the verdicts on requirements to the outcome of the run: levels, and inconclusive verdicts.

    level    fails             undecided
    error    fails the run     by the policy
    warn     is a warning      is a warning
    info     is shown          is shown
    off      is not judged     is not judged

The policy is ``report`` (the run is inconclusive, which has an exit status of its own), ``fail``
(as if it had failed) or ``pass`` (a warning; for pipelines that must not stop for lack of
evidence). A requirement that waits for a history to have enough runs is information, except with
``fail``: then it is undecided like any other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from r2bspec.judge.verdict import Outcome, OverallOutcome, RequirementVerdict

InconclusivePolicy = Literal["report", "fail", "pass"]


def outcome_of(
    requirements: Sequence[RequirementVerdict],
    policy: InconclusivePolicy = "report",
    starts: int = 0,
) -> tuple[OverallOutcome, str]:
    """The outcome of a valid run, and one sentence for it.

    Args:
        requirements: the verdicts on them.
        policy: what an inconclusive requirement does to the run.
        starts: of how many starts of the processes the sentence says that it is; 0 if it is not
            about a run. A verdict on one start is true of that start: another may have another.
    """
    counted = [one for one in requirements if one.level == "error"]
    outcome = worst_outcome([one.outcome for one in counted], policy)
    learning = [one.learning for one in requirements if one.learning and one.level != "error"]
    parts = [_sentence(counted, outcome)] if counted or not learning else []
    if learning:
        parts.append(_learning_sentence(learning))
    text = f"{' '.join(parts)}{_warnings(requirements, policy)}"
    if starts and requirements:
        text = f"{_starts_phrase(starts)}: {text[:1].lower()}{text[1:]}"
    return outcome, text


def _starts_phrase(starts: int) -> str:
    """What a verdict is about, as the beginning of a sentence."""
    if starts == 1:
        return "Of this start of the processes"
    return f"Over {starts} starts of the processes"


def worst_outcome(outcomes: Sequence[Outcome], policy: InconclusivePolicy = "report") -> Outcome:
    """The worst of some outcomes; the policy decides how inconclusive counts."""
    if "fail" in outcomes:
        return "fail"
    if "inconclusive" not in outcomes:
        return "pass"
    return "inconclusive" if policy == "report" else policy


def _sentence(counted: Sequence[RequirementVerdict], outcome: Outcome) -> str:
    total = len(counted)
    if not total:
        return "The spec has no objective to judge."
    failed = sum(one.outcome == "fail" for one in counted)
    open_ = sum(one.outcome == "inconclusive" for one in counted)
    if total == 1:
        if failed:
            return "The requirement is not met."
        if not open_:
            return "The requirement is met."
        return f"The requirement could not be decided{_policy(outcome)}."
    if failed:
        left = f", {open_} could not be decided" if open_ else ""
        return f"{failed} of {total} requirements failed{left}."
    if open_:
        return f"{open_} of {total} requirements could not be decided{_policy(outcome)}."
    return f"All {total} requirements are met."


def _learning_sentence(learning: Sequence[str]) -> str:
    """How far the history is for the requirements that wait for it."""
    waits = "1 requirement waits" if len(learning) == 1 else f"{len(learning)} requirements wait"
    return f"Learning, {min(learning)}: {waits} for the history."


def _policy(outcome: Outcome) -> str:
    if outcome == "inconclusive":
        return ""
    return f", which counts as {outcome} by the policy"


def _warnings(requirements: Sequence[RequirementVerdict], policy: InconclusivePolicy) -> str:
    number = sum(one.level == "warn" and one.outcome != "pass" for one in requirements)
    if not any(one.level == "error" for one in requirements) and not number:
        return ""
    if policy == "pass":
        number += sum(
            one.level == "error" and one.outcome == "inconclusive" for one in requirements
        )
    return f" {number} warning{'s' if number > 1 else ''}." if number else ""
