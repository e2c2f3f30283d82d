"""How long a comparison will take, depending on how it is played."""

from __future__ import annotations

from r2bspec.compare.interleaved_comparison import (
    STARTS_OF_BOTH,
    needs_base_alone,
    turns_of,
    why_not_by_turns,
)
from r2bspec.compare.side_process import STEPS
from r2bspec.plan.plan import Plan
from r2bspec.plan.time_estimate import TimeEstimate, estimate_pairs, estimate_turns


def estimate_comparison(head: Plan, pairs: int | None = None) -> TimeEstimate:
    """Return the time that a comparison with a plan of the same kind will take.

    Args:
        head: with all iterations.
        pairs: the most pairs of runs, or starts of both sides; the usual number if None.
    """
    if why_not_by_turns(head, head):
        return estimate_pairs(head, pairs)
    starts = pairs or STARTS_OF_BOTH
    steps = STEPS * len(turns_of(head))
    return estimate_turns(head, starts, steps, base_alone=needs_base_alone(head))
