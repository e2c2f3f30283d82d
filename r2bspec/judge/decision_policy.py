"""How a run is judged, as its plan states it before the run."""

from __future__ import annotations

from dataclasses import dataclass

from r2bspec.judge.interference_policy import InterferencePolicy
from r2bspec.judge.interim_looks import InterimLooks
from r2bspec.judge.outcome import InconclusivePolicy
from r2bspec.language.confidence import CONFIDENCE
from r2bspec.plan.plan import GatePlan, Plan
from r2bspec.plan.smoke_plan import is_smoke_plan


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
