"""Verdicts as frozen values that serialise to JSON."""

from __future__ import annotations

from typing import Final, Literal

import msgspec

CONFIDENCE: Final = 0.95
"""Of every decision, one-sided each way: PASS and FAIL are each wrong in at most 5 % of runs."""

Outcome = Literal["pass", "fail", "inconclusive"]

Method = Literal[
    "exact binomial",
    "t over iterations",
    "observation",
    "search bracket",
    "sequential probe",
    "none",
]
"""How a requirement was decided. ``none``: there was nothing to decide it by."""

OverallOutcome = Literal["pass", "fail", "inconclusive", "invalid", "incomplete"]

EXIT_CODES: Final[dict[OverallOutcome, int]] = {
    "pass": 0,
    "fail": 1,
    "inconclusive": 3,
    "invalid": 4,
    "incomplete": 4,
}


class ShareTest(msgspec.Struct, frozen=True, kw_only=True):
    """The binomial test behind a percentile or a share.

    Of `n` messages `over` are over the limit, `lost` of them because they never arrived.
    `lower` and `upper` are the one-sided Clopper-Pearson bounds on the true share, `allowed` is
    what the requirement allows. For a requirement with ``>``, `over` counts what is under.
    """

    n: int
    over: int
    lost: int
    share: float
    lower: float
    upper: float
    allowed: float


class RequirementVerdict(msgspec.Struct, frozen=True, kw_only=True):
    """One requirement, judged.

    `estimate`, `lower`, `upper` and `limit` are in `unit`, the metric's own. None stands for no
    value, and for a bound that is not bounded; `lost` is True where the estimate itself is a
    message that never arrived. `n` is what the decision rests on: messages for the exact
    binomial and most observations, iterations for t, probes for a search.

    Attributes:
        objective: the name of the objective that the requirement belongs to.
        text: the requirement as the user wrote it.
        over: messages over the limit (see `ShareTest`), where single messages were compared.
        rule_of_three: for an observation that held for n messages, the share of messages for
            which it may still not hold, at the stated confidence; otherwise None.
        reason: the decision in one sentence.
        settle: for an inconclusive requirement, what would settle it; otherwise empty.
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
    settle: str


class Unusable(msgspec.Struct, frozen=True, kw_only=True):
    """An offered rate at which nothing can be judged, and why."""

    offered_hz: float
    reason: str


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    """A run, judged: the outcome, the exit code that says it, and every requirement.

    `reason` is the outcome in one sentence.
    """

    outcome: OverallOutcome
    exit_code: int
    reason: str
    requirements: tuple[RequirementVerdict, ...]
    unusable: tuple[Unusable, ...]
