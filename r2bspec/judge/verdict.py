"""Verdicts as frozen values that serialise to JSON, and how the verdict on a run is derived.

Outcome of the run
------------------

    level    fails             undecided
    error    fails the run     by the policy
    warn     is a warning      is a warning
    info     is shown          is shown
    off      is not judged     is not judged

The policy is ``report`` (the run is inconclusive, which has an exit status of its own), ``fail``
(as if it had failed) or ``pass`` (a warning; for pipelines that must not stop for lack of
evidence).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal

import msgspec

from r2bspec.errors import ExitStatus
from r2bspec.judge.methods import Method

Outcome = Literal["pass", "fail", "inconclusive"]

Level = Literal["error", "warn", "info", "off"]
"""What a requirement that is not met does to the run: it fails it, is a warning, or is only shown.
``off``: it is not judged."""

OverallOutcome = Literal["pass", "fail", "inconclusive", "invalid", "incomplete"]

EXIT_CODES: Final[dict[OverallOutcome, ExitStatus]] = {
    "pass": ExitStatus.OK,
    "fail": ExitStatus.FINDINGS_OR_FAILED,
    "inconclusive": ExitStatus.INCONCLUSIVE,
    "invalid": ExitStatus.RUN_FAILED,
    "incomplete": ExitStatus.RUN_FAILED,
}


class ShareTest(msgspec.Struct, frozen=True, kw_only=True):
    """The binomial test of a percentile or a share.

    Of `n` messages `over` are over the limit, `lost` of them because they never arrived. `lower`
    and `upper` are the one-sided Clopper-Pearson bounds on the true share, `allowed` is what the
    requirement allows. For a requirement with ``>``, `over` counts messages under the limit; for a
    requirement about windows, windows are counted instead of messages.

    Attributes:
        effective_n: effective sample size: the number of independent messages equivalent to `n`.
        differ: why `effective_n` is below `n`: the messages over the limit come more in some
            ``starts``, ``iterations``, or ``stretches`` of a single iteration than in others.
    """

    n: int
    effective_n: float
    over: int
    differ: Literal["", "stretches", "iterations", "starts"]
    lost: int
    share: float
    lower: float
    upper: float
    allowed: float


class BaselineEstimate(msgspec.Struct, frozen=True, kw_only=True):
    """The values behind a ratio, for a requirement ``of baseline``; all in `unit`.

    Attributes:
        base: the geometric mean of the base's values; None where one is missing.
        head: likewise.
        base_values: one for each pair, in their order; None for one that is missing or lost.
        head_values: likewise.
        deviation: the standard deviation of the logarithms behind the interval; 0.02 is
            about 2 %.
    """

    unit: str
    base: float | None
    head: float | None
    base_values: tuple[float | None, ...]
    head_values: tuple[float | None, ...]
    deviation: float | None


RequirementKey = tuple[str, str, str | None, float | None]
"""Objective, text, monitor and offered rate of a requirement."""


class RequirementVerdict(msgspec.Struct, frozen=True, kw_only=True):
    """The verdict on a requirement.

    `estimate`, `lower`, `upper` and `limit` are in `unit`, the metric's own. None is no value, or
    no bound; `lost` is True if the estimate itself is a message that never arrived. `n` is the
    sample size of the decision: messages for the exact binomial and most observations, iterations
    for t, probes for a search.

    Attributes:
        objective: the name of the objective that the requirement belongs to.
        text: the requirement as the user wrote it.
        effective_n: the effective sample size; None if `n` is 0.
        over: messages over the limit (see `ShareTest`), where single messages were compared.
        rule_of_three: for an observation that was met by n messages, the share of messages for
            which it may still not be met, at the stated confidence; otherwise None.
        reason: the decision in one sentence.
        remedy: for an inconclusive requirement, what would decide it; otherwise empty.
        level: what it does to the run if it is not met.
        look: the planned interim look at which it was decided, counted from 1; 0 if none were
            planned, of which there are `looks`.
        notes: further facts behind the decision, one sentence each: an earlier look, a
            confirmation that succeeded or failed, host interference.
        compared: base and head, where the requirement is on their ratio.
        weakened: whether it was decided, and is inconclusive only because of host interference.
        early: whether it was decided before the declared starts or pairs, without room for what
            they may meet.
        untested: what would change the decision and cannot be seen in the run, in a sentence;
            empty if nothing of the kind would.
        left_open: whether it is open on a busy machine where the work at its rate is decided, and
            does not keep the run from passing.
    """

    objective: str
    text: str
    at_hz: float | None
    metric: str
    monitor: str | None
    outcome: Outcome
    method: Method
    estimate: float | None
    lower: float | None
    upper: float | None
    limit: float | None
    unit: str
    n: int
    confidence: float
    over: int | None
    lost: bool
    share: ShareTest | None
    rule_of_three: float | None
    reason: str
    remedy: str
    effective_n: float | None = None
    level: Level = "error"
    look: int = 0
    looks: int = 0
    notes: tuple[str, ...] = ()
    compared: BaselineEstimate | None = None
    weakened: bool = False
    early: bool = False
    untested: str = ""
    left_open: bool = False

    @property
    def key(self) -> RequirementKey:
        """The identity of the requirement among all of a run."""
        return self.objective, self.text, self.monitor, self.at_hz

    @property
    def fails_run(self) -> bool:
        """Whether it is a failure that counts for the run."""
        return self.outcome == "fail" and self.level == "error"

    def is_at(self, rate_hz: float) -> bool:
        """Return True if it is of this offered rate."""
        return self.at_hz is not None and math.isclose(rate_hz, self.at_hz)

    def noted(self, *notes: str) -> RequirementVerdict:
        """Return the verdict with further notes."""
        return msgspec.structs.replace(self, notes=(*self.notes, *notes)) if notes else self

    def held_back(self, doubt: str, *, opens: bool = False) -> RequirementVerdict:
        """Return the verdict, marked as having too little room for what the run has not met.

        Args:
            doubt: a sentence, or empty.
            opens: whether a FAIL becomes inconclusive.
        """
        if not doubt:
            return self
        noted = msgspec.structs.replace(self.noted(doubt), early=True)
        if not opens or self.outcome != "fail":
            return noted
        remedy = "Play the declared starts: raise 'gate.time_budget', or leave it out."
        return msgspec.structs.replace(noted, outcome="inconclusive", remedy=remedy)

    def opened(self, note: str, remedy: str) -> RequirementVerdict:
        """Return the verdict as undecided because of host interference."""
        return msgspec.structs.replace(
            self.noted(note), outcome="inconclusive", remedy=remedy, weakened=True
        )


class Unusable(msgspec.Struct, frozen=True, kw_only=True):
    """An offered rate at which nothing can be judged, and the reason."""

    offered_hz: float
    reason: str


class DisturbedIteration(msgspec.Struct, frozen=True, kw_only=True):
    """An iteration affected by host interference.

    Attributes:
        segment: its id.
        reasons: the interference, in words; at least one.
        rerun: the id of the iteration that was played in its place, or empty.
        rerun_of: the id of the iteration in whose place it was played itself, or empty.
        start: the start of the graph's processes that it was played in.
        taken: the largest share of the time that others can have taken from the run.
    """

    segment: str
    rate_hz: float
    reasons: tuple[str, ...]
    rerun: str = ""
    rerun_of: str = ""
    start: int = 1
    taken: float = 0.0


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    """The verdict on a run: the outcome, its exit code, and every requirement.

    `reason` is the outcome in one sentence; it says of how many `starts` of all processes the
    verdict is (0 if it is not about a run): with 1, it is of this start, and another start may
    differ. `disturbed` are the iterations affected by host interference, including those of the
    confirmation session; their effect on a requirement is in its notes.
    """

    outcome: OverallOutcome
    exit_code: int
    reason: str
    requirements: tuple[RequirementVerdict, ...]
    unusable: tuple[Unusable, ...]
    disturbed: tuple[DisturbedIteration, ...] = ()
    starts: int = 0

    @property
    def is_judged(self) -> bool:
        """Whether the run was usable, so that the outcome is that of its requirements."""
        return self.outcome not in {"invalid", "incomplete"}

    @property
    def by_key(self) -> dict[RequirementKey, RequirementVerdict]:
        """Its requirements by their keys; empty if the run was not usable."""
        return {each.key: each for each in self.requirements} if self.is_judged else {}

    @property
    def failed_keys(self) -> set[RequirementKey]:
        """The keys of its requirements that fail."""
        return {each.key for each in self.requirements if each.outcome == "fail"}

    def with_requirements(
        self, requirements: tuple[RequirementVerdict, ...], policy: InconclusivePolicy
    ) -> Verdict:
        """Return the verdict with other requirements, and the outcome that follows from them."""
        if not self.is_judged:
            return msgspec.structs.replace(self, requirements=requirements)
        outcome, reason = outcome_of(requirements, policy, self.starts)
        return msgspec.structs.replace(
            self,
            outcome=outcome,
            exit_code=EXIT_CODES[outcome],
            reason=reason,
            requirements=requirements,
        )

    def saying(self, sentence: str) -> Verdict:
        """Return the verdict with one more sentence in its reason."""
        return msgspec.structs.replace(self, reason=f"{self.reason} {sentence}")


InconclusivePolicy = Literal["report", "fail", "pass"]
"""What an inconclusive requirement does to the run."""

InterferencePolicy = Literal["tolerate", "note"]
"""What host interference may do to a verdict (`r2bspec.judge.affected_iterations`)."""


def outcome_of(
    requirements: Sequence[RequirementVerdict],
    policy: InconclusivePolicy = "report",
    starts: int = 0,
) -> tuple[OverallOutcome, str]:
    """Return the outcome of a valid run, and one sentence for it.

    Args:
        requirements: the verdicts on them.
        policy: what an inconclusive requirement does to the run.
        starts: of how many starts of the processes the sentence says that it is; 0 if it is not
            about a run. A verdict on one start is true of that start: another may have another.
    """
    counted = [
        requirement
        for requirement in requirements
        if requirement.level == "error" and not requirement.left_open
    ]
    outcome = worst_outcome([requirement.outcome for requirement in counted], policy)
    left_open = sum(requirement.left_open for requirement in requirements)
    busy = f" {left_open} more could not be decided on this busy machine." if left_open else ""
    text = f"{_sentence(counted, outcome)}{busy}{_warnings(requirements, policy)}"
    if starts and requirements:
        text = f"{_starts_phrase(starts)}: {text[:1].lower()}{text[1:]}"
    return outcome, text


def _starts_phrase(starts: int) -> str:
    """Return what a verdict is about, as the beginning of a sentence."""
    if starts == 1:
        return "Of this start of the processes"
    return f"Over {starts} starts of the processes"


def worst_outcome(outcomes: Sequence[Outcome], policy: InconclusivePolicy = "report") -> Outcome:
    """Return the worst of some outcomes; the policy decides how inconclusive counts."""
    if "fail" in outcomes:
        return "fail"
    if "inconclusive" not in outcomes:
        return "pass"
    return "inconclusive" if policy == "report" else policy


def _sentence(counted: Sequence[RequirementVerdict], outcome: Outcome) -> str:
    total = len(counted)
    if not total:
        return "The spec has no objective to judge."
    failed = sum(requirement.outcome == "fail" for requirement in counted)
    open_ = sum(requirement.outcome == "inconclusive" for requirement in counted)
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


def _policy(outcome: Outcome) -> str:
    if outcome == "inconclusive":
        return ""
    return f", which counts as {outcome} by the policy"


def _warnings(requirements: Sequence[RequirementVerdict], policy: InconclusivePolicy) -> str:
    number = sum(
        requirement.level == "warn" and requirement.outcome != "pass"
        for requirement in requirements
    )
    if not any(requirement.level == "error" for requirement in requirements) and not number:
        return ""
    if policy == "pass":
        number += sum(
            requirement.level == "error" and requirement.outcome == "inconclusive"
            for requirement in requirements
        )
    return f" {number} warning{'s' if number > 1 else ''}." if number else ""
