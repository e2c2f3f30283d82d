"""How a run is judged, as its plan states it before the run: confidence, interim looks, policies.

Interim looks
-------------

Looks at a growing run are planned before it starts, and the error is divided among them.

A run that is extended until it passes is bound to pass in the end: three unplanned looks at the
95 % level pass one bad graph in ten. So the looks are planned (usually at 1, 2 and 4 times the
declared iterations), and each gets a part of the error alpha = 1 - confidence. With the cumulated
iterations m_1 < m_2 < .. < m_l, look i may be wrong in a share

    alpha_i = alpha (m_i - m_(i-1)) / m_l,        m_0 = 0,

of all runs, each way: the error is spent in proportion to the new iterations. By Boole's inequality
the chance that any look passes a requirement that is not met is at most sum alpha_i = alpha,
however the looks depend on each other, and the same for failing one that is met. No assumption is
made about the test, so this serves the binomial test and t alike.

A requirement is decided at the first look that decides it. A later look, which another
requirement needed, may still turn its PASS into a FAIL, but nothing else: both errors stay
within the sum.

With ``--abort-on-fail`` a rate also ends between looks, once a requirement fails for certain. It
fails then on what was played, and what is left cannot make it pass:

    observed    a count of faults, or an extreme, is beyond its limit, and it only grows
    share       of N planned messages, k are over the limit already, and the test of the whole
                plan fails though all the others are within it: the lower bound of k in N exceeds
                the allowed share, with the effective sample size that messages have had so far

k only grows, so that k / N stays above the allowed share, and no look passes a share above it.
For the same reason to stop there costs no error: what has reached the bound of the whole plan early
would be beyond it at the end. A first iteration, or the first of several starts, does not show
whether the next one is like it, and ends only what was observed. Means, windows, and the rest of a
live run have no such bound.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import msgspec

from r2bspec.judge.measure.samples import RunSamples, starts_of
from r2bspec.judge.measure.units import show
from r2bspec.judge.methods import METHODS
from r2bspec.judge.statistics.binomial import lower_bound
from r2bspec.judge.verdict import (
    InconclusivePolicy,
    InterferencePolicy,
    RequirementVerdict,
    Verdict,
)
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.language.spec import Objective
from r2bspec.plan.plan import GatePlan, Plan
from r2bspec.plan.smoke_plan import is_smoke_plan

LOOK_FACTORS = (1, 2, 4)
"""Of the declared number of iterations."""

_MIN_PIECES = 2

LookDecision = Literal["pass", "fail", "go on", "inconclusive"]
"""What to do after a look: stop because everything is decided, or play the next iterations; stop
without a decision because no look is left, or because more iterations would decide nothing."""

_GROWING = frozenset(name for name, traits in METHODS.items() if traits.grows)


@dataclass(frozen=True)
class InterimLooks:
    """The numbers of iterations after which a run is judged, ascending; at least one."""

    iterations: tuple[int, ...]

    def __post_init__(self) -> None:
        ends = (0, *self.iterations)
        if not self.iterations or any(b <= a for a, b in pairwise(ends)):
            raise ValueError("looks are planned at one or more ascending numbers of iterations")

    @classmethod
    def planned(cls, iterations: int, max_iterations: int) -> InterimLooks:
        """Looks at 1, 2 and 4 times the declared iterations, up to and at `max_iterations`.

        Args:
            iterations: the declared number.
            max_iterations: the largest number of iterations.
        """
        max_iterations = max(iterations, max_iterations)
        ends = {min(iterations * factor, max_iterations) for factor in LOOK_FACTORS} | {
            max_iterations
        }
        return cls(tuple(sorted(ends)))

    def __len__(self) -> int:
        return len(self.iterations)

    def error_share(self, look: int) -> float:
        """The part of the error that a look may make; looks are counted from 1."""
        before = self.iterations[look - 2] if look > 1 else 0
        return (self.iterations[look - 1] - before) / self.iterations[-1]

    def confidence_at(self, look: int, confidence: float = CONFIDENCE) -> float:
        """The confidence at which a look decides, for decisions of a given confidence."""
        return 1 - (1 - confidence) * self.error_share(look)

    def completed_looks(self, iterations: int) -> int:
        """How many looks so many complete iterations allow; 0 before the first."""
        return sum(end <= iterations for end in self.iterations)


def decide_after_look(
    looks: InterimLooks, look: int, requirements: Sequence[RequirementVerdict]
) -> LookDecision:
    """What to do after a look.

    A requirement that fails stops the run: a second session in new processes confirms the failure
    or does not (`r2bspec.judge.confirmation`); no more iterations of this session are played.

    Args:
        looks: the plan.
        look: the look that was taken, from 1.
        requirements: the verdicts after it, those that count for the run.
    """
    outcomes = {one.outcome for one in requirements}
    if "fail" in outcomes:
        return "fail"
    if "inconclusive" not in outcomes:
        return "pass"
    can_grow = any(one.outcome == "inconclusive" and one.method in _GROWING for one in requirements)
    return "go on" if can_grow and look < len(looks) else "inconclusive"


def combine_looks(looks: InterimLooks, judged: Sequence[RequirementVerdict]) -> RequirementVerdict:
    """One requirement at each look so far, as one verdict.

    Args:
        looks: the plan.
        judged: the verdicts of look 1, 2, .., each at the look's own confidence.
    """
    latest = len(judged)
    numbered = [
        msgspec.structs.replace(one, look=number, looks=len(looks))
        for number, one in enumerate(judged, start=1)
    ]
    last = numbered[-1]
    if last.method not in _GROWING:
        return last
    # An observation is no test: later iterations may change it.
    first = next(
        (one for one in numbered if one.outcome != "inconclusive" and one.method in _GROWING), last
    )
    chosen = last if last.outcome == "fail" else first
    note = _note(looks, chosen, latest)
    remedy = chosen.remedy
    if chosen.outcome == "inconclusive" and latest < len(looks):
        remedy = f"The next look, after {looks.iterations[latest]} iterations, may decide it."
    return msgspec.structs.replace(chosen, remedy=remedy, notes=(*chosen.notes, note))


def _note(looks: InterimLooks, chosen: RequirementVerdict, latest: int) -> str:
    if len(looks) == 1:
        return f"Judged once, after {looks.iterations[0]} iterations, as planned."
    when = f"look {chosen.look} of {len(looks)}, after {looks.iterations[chosen.look - 1]}"
    confidence = show(chosen.confidence, "share", 4)
    if chosen.outcome == "inconclusive":
        return f"Undecided at {when} iterations, at {confidence} confidence."
    later = f"; {latest} were taken" if latest > chosen.look else ""
    return f"Decided at {when} iterations, at {confidence} confidence{later}."


def certain_failures(
    verdict: Verdict, samples: RunSamples, plan: Plan
) -> Iterator[RequirementVerdict]:
    """The requirements that have failed and cannot pass any more, whatever the rest of the run is.

    Where an inconclusive requirement counts as passed, only an observation is certain: iterations
    that differ can leave a test undecided.

    Args:
        verdict: on the run so far.
        samples: of the run so far.
        plan: of the run.
    """
    for requirement in verdict.requirements:
        if requirement.level != "error" or requirement.outcome != "fail":
            continue
        if requirement.method == "observation":
            if _only_gets_worse(requirement):
                yield requirement
        elif plan.gate.inconclusive != "pass" and _exceeds_whole_plan(requirement, samples, plan):
            yield requirement


def _only_gets_worse(failed: RequirementVerdict) -> bool:
    """Whether an observed value is beyond its limit, on the side to which it only moves."""
    value = math.inf if failed.lost else failed.estimate
    if value is None or failed.limit is None:
        return False
    part = failed.metric.rpartition(".")[2]
    if part == "min":
        return value < failed.limit
    none_allowed = failed.metric == "drop_rate" and failed.limit == 0
    return value > failed.limit and (part == "max" or failed.unit == "count" or none_allowed)


def _exceeds_whole_plan(failed: RequirementVerdict, samples: RunSamples, plan: Plan) -> bool:
    """Whether the binomial test of all planned messages fails with those over the limit so far."""
    test = failed.share
    if failed.method != "exact binomial" or test is None or samples.mode == "live":
        return False
    played = samples.iterations.get(failed.at_hz or 0.0, ())
    number = max(
        (
            max(play.iterations, play.max_iterations)
            for play in plan.play
            if play.rate_hz == failed.at_hz
        ),
        default=0,
    )
    pieces = len(set(starts_of(played))) if plan.starts > 1 else len(played)
    if not number or pieces < _MIN_PIECES:
        return False
    # An iteration may have one output, or one interval at its ends, more than another.
    longest = 1 + max(
        iteration.monitors[failed.monitor].expected
        if failed.monitor is not None
        else iteration.playback.sent
        for iteration in played
    )
    independent = test.effective_n / test.n
    whole = max(number * longest, test.n)
    bound = lower_bound(test.over * independent, whole * independent, failed.confidence)
    return bound > test.allowed


@dataclass(frozen=True)
class DecisionPolicy:
    """Everything that a verdict depends on besides objectives and samples.

    Attributes:
        confidence: of every decision, one-sided each way, where the objective has none of its
            own.
        looks: the planned interim looks; None for a run of a fixed length.
        inconclusive: what an inconclusive requirement does to the run.
        interference: what host interference does to a requirement.
        confirm: whether a second session, where one was played, has to confirm a FAIL.
        smoke: whether the run was made to show that the graph works, and not to be judged.
    """

    confidence: float = CONFIDENCE
    looks: InterimLooks | None = None
    inconclusive: InconclusivePolicy = "report"
    interference: InterferencePolicy = "note"
    confirm: bool = True
    smoke: bool = False


def decision_policy(plan: Plan, gate: GatePlan | None = None) -> DecisionPolicy:
    """The decision policy of a plan.

    Args:
        plan: as it was played.
        gate: of another spec by which it is judged; that of the plan if None. Its time budget
            changes nothing, because nothing is played any more.
    """
    gate = gate or plan.gate
    plays = (*plan.play, *([plan.play_at_peak] if plan.play_at_peak else []))
    growing = [one for one in plays if one.max_iterations > one.iterations]
    looks = (
        InterimLooks.planned(growing[0].iterations, growing[0].max_iterations) if growing else None
    )
    return DecisionPolicy(
        confidence=gate.confidence,
        looks=looks,
        inconclusive=gate.inconclusive,
        interference=gate.interference,
        confirm=gate.confirm,
        smoke=is_smoke_plan(plan),
    )


def without_own_confidence(objectives: Mapping[str, Objective]) -> dict[str, Objective]:
    """The objectives as a second session judges them: at the confidence of the policy."""
    return {
        name: msgspec.structs.replace(objective, confidence=None)
        for name, objective in objectives.items()
    }
