"""How a run is judged, as its plan states it before the run: confidence, interim looks, policies.

Interim looks
-------------

A growing run is judged at planned looks, among which the error is divided
(`r2bspec.plan.interim_looks`).

A requirement is decided at the first look that decides it; before the declared starts, only with
room for what they may meet (`r2bspec.judge.unmet`). A later look, which another requirement needed,
may still turn its PASS into a FAIL, but nothing else: both errors stay within the sum.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import msgspec

from r2bspec.judge.methods import METHODS
from r2bspec.judge.verdict import InconclusivePolicy, InterferencePolicy, RequirementVerdict
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.language.spec import Objective
from r2bspec.plan.interim_looks import InterimLooks
from r2bspec.plan.plan import GatePlan, Plan
from r2bspec.plan.smoke_plan import is_smoke_plan

LookDecision = Literal["pass", "fail", "go on", "inconclusive"]
"""What to do after a look: stop because everything is decided, or play the next iterations; stop
without a decision because no look is left, or because more iterations would decide nothing."""

_GROWING = frozenset(name for name, traits in METHODS.items() if traits.grows)


def decide_after_look(
    looks: InterimLooks, look: int, requirements: Sequence[RequirementVerdict]
) -> LookDecision:
    """Return what to do after a look.

    A requirement that fails stops the run: a second session in new processes confirms the failure
    or does not (`r2bspec.judge.confirmation`); no more iterations of this session are played. A
    requirement that passes stops the run before the declared iterations only if a test has decided
    it: an observation is the more certain the more was observed. An early decision needs room for
    what the run has not met (`r2bspec.judge.unmet`). Requirements that need no iterations do not
    delay the decision.

    Args:
        looks: the plan.
        look: the look that was taken, from 1.
        requirements: the verdicts after it, those that count for the run.
    """
    if any(one.outcome == "fail" and not one.early for one in requirements):
        return "fail"
    if looks.iterations[look - 1] < looks.declared:
        waiting = [
            requirement
            for requirement in requirements
            if METHODS[requirement.method].rests_on == "iterations"
        ]
        decided = all(
            requirement.outcome == "pass"
            and requirement.method in _GROWING
            and not requirement.early
            for requirement in waiting
        )
        return "pass" if waiting and decided else "go on"
    if all(requirement.outcome == "pass" for requirement in requirements):
        return "pass"
    return (
        "go on" if look < len(looks) and any(map(_can_be_decided, requirements)) else "inconclusive"
    )


def _can_be_decided(one: RequirementVerdict) -> bool:
    """Return whether more iterations may decide a requirement.

    They may not where interference has opened it, or something else than the width of its interval.
    """
    if one.outcome != "inconclusive" or one.method not in _GROWING or one.weakened:
        return False
    if one.lower is None or one.upper is None or one.limit is None:
        return True
    return one.lower <= one.limit <= one.upper


def combine_looks(looks: InterimLooks, judged: Sequence[RequirementVerdict]) -> RequirementVerdict:
    """Combine the verdicts on a requirement at all looks so far.

    Args:
        looks: the plan.
        judged: the verdicts of look 1, 2, .., each at the look's own confidence.
    """
    numbered = [
        msgspec.structs.replace(requirement, look=number, looks=len(looks))
        for number, requirement in enumerate(judged, start=1)
    ]
    last = numbered[-1]
    if last.method not in _GROWING:
        return last
    # An observation is no test: later iterations may change it.
    decided = (
        requirement
        for requirement in numbered
        if requirement.method in _GROWING and not requirement.early
    )
    first = next((one for one in decided if one.outcome != "inconclusive"), last)
    chosen = last if last.outcome == "fail" and not last.early else first
    if looks.shares and chosen.outcome == "fail":
        # The starts after a failure confirm it in the same list: it stands if they do not mend it.
        return last
    return chosen


@dataclass(frozen=True)
class DecisionPolicy:
    """Everything that a verdict depends on besides objectives and samples.

    Attributes:
        confidence: the confidence of every decision, one-sided each way, where the objective has
            none of its own.
        looks: the planned interim looks; None for a run of a fixed length.
        early: whether that run is the beginning of a longer one, as at a look at pairs.
        inconclusive: what an inconclusive requirement does to the run.
        interference: what host interference does to a requirement.
        confirm: whether a second session, where one was played, has to confirm a FAIL.
        smoke: whether the run was made to show that the graph works, and not to be judged.
    """

    confidence: float = CONFIDENCE
    looks: InterimLooks | None = None
    early: bool = False
    inconclusive: InconclusivePolicy = "report"
    interference: InterferencePolicy = "note"
    confirm: bool = True
    smoke: bool = False


def decision_policy(plan: Plan, gate: GatePlan | None = None) -> DecisionPolicy:
    """Return the decision policy of a plan.

    Args:
        plan: as it was played.
        gate: the gate of another spec by which it is judged; that of the plan if None. Its time
            budget changes nothing, because nothing is played any more.
    """
    gate = gate or plan.gate
    return DecisionPolicy(
        confidence=gate.confidence,
        looks=InterimLooks.of_plays(plan.plays, plan.starts),
        inconclusive=gate.inconclusive,
        interference=gate.interference,
        confirm=gate.confirm,
        smoke=is_smoke_plan(plan),
    )


def without_own_confidence(objectives: Mapping[str, Objective]) -> dict[str, Objective]:
    """Return the objectives with the confidence of the policy, as a second session uses them."""
    return {
        name: msgspec.structs.replace(objective, confidence=None)
        for name, objective in objectives.items()
    }
