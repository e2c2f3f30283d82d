"""Interim looks at a growing run, planned before it starts, with the error divided among them.

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
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import msgspec

from r2bspec.judge.methods.method_registry import METHODS
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.language.confidence import CONFIDENCE
from r2bspec.measure.units import show

LOOK_FACTORS = (1, 2, 4)
"""Of the declared number of iterations."""

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
