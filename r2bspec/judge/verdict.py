"""Verdicts as frozen values that serialise to JSON."""

from __future__ import annotations

from typing import Final, Literal

import msgspec

from r2bspec.exit_status import ExitStatus
from r2bspec.judge.methods.method_registry import Method

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

    Of `n` messages `over` are over the limit, `lost` of them because they never arrived.
    `lower` and `upper` are the one-sided Clopper-Pearson bounds on the true share, `allowed` is
    what the requirement allows. For a requirement with ``>``, `over` counts what is under; for
    one about windows, windows are counted and not messages.

    Attributes:
        effective_n: effective sample size: the number of independent messages equivalent to `n`.
        bursts: in how many bursts the messages over the limit come.
        clustering: why `effective_n` is below `n`: they come in ``bursts`` one after the other,
            in ``clusters`` near one another, or in some ``iterations`` or ``starts`` more than in
            others.
        burst_tolerance: for a share that was shown to be small enough, the mean length of bursts up
            to which the same counts would still show it; otherwise None. Bursts that are too rare
            to occur in this run cannot be seen in it.
    """

    n: int
    effective_n: float
    over: int
    bursts: int
    clustering: Literal["", "bursts", "clusters", "iterations", "starts"]
    lost: int
    share: float
    lower: float
    upper: float
    allowed: float
    burst_tolerance: float | None


class Compared(msgspec.Struct, frozen=True, kw_only=True):
    """The values behind a ratio, for a requirement ``of baseline``; all in `unit`.

    Attributes:
        base: the geometric mean of the base's values; None where one is missing.
        head: likewise.
        base_values: one for each pair, earlier run, or iteration of a stored run, oldest first;
            None for one that is missing or lost.
        head_values: one for each pair or iteration; a single one for a history.
        deviation: the standard deviation of the logarithms behind the interval; 0.02 is
            about 2 %.
    """

    unit: str
    base: float | None
    head: float | None
    base_values: tuple[float | None, ...]
    head_values: tuple[float | None, ...]
    deviation: float | None


class RequirementVerdict(msgspec.Struct, frozen=True, kw_only=True):
    """One requirement, judged.

    `estimate`, `lower`, `upper` and `limit` are in `unit`, the metric's own. None is no value, or
    no bound; `lost` is True where the estimate itself is a message that never arrived. `n` is the
    sample size of the decision: messages for the exact binomial and most observations, iterations
    for t, probes for a search.

    Attributes:
        objective: the name of the objective that the requirement belongs to.
        text: the requirement as the user wrote it.
        effective_n: the effective sample size; None if `n` is 0.
        over: messages over the limit (see `ShareTest`), where single messages were compared.
        bursts: in how many bursts they come, where that is known.
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
        learning: while a history has too few runs to decide, which of them this one is, such as
            ``3 of 5``; otherwise empty.
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
    bursts: int | None = None
    level: Level = "error"
    look: int = 0
    looks: int = 0
    notes: tuple[str, ...] = ()
    compared: Compared | None = None
    weakened: bool = False
    learning: str = ""


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
    """A run, judged: the outcome, its exit code, and every requirement.

    `reason` is the outcome in one sentence; it says of how many `starts` of all processes the
    verdict is (0 if it is not about a run): with 1, it is of this start, and another one may
    differ. `unseen_starts` is the largest share of starts of a kind that is not among these, at
    95 % confidence (0.45 for 5 starts); None in results of versions that did not state it.
    `disturbed` are the iterations affected by host interference, those of the confirmation session
    among them; their effect on a requirement is in its notes. `limits` is what no test can tell
    from this run, a sentence each.
    """

    outcome: OverallOutcome
    exit_code: int
    reason: str
    requirements: tuple[RequirementVerdict, ...]
    unusable: tuple[Unusable, ...]
    disturbed: tuple[DisturbedIteration, ...] = ()
    starts: int = 0
    unseen_starts: float | None = None
    limits: tuple[str, ...] = ()
