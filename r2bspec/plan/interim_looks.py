"""Which iterations each start of a run plays, and when the run is judged while it grows.

A run is judged after each start from the third on, and ends as soon as everything is decided:
starts differ by more than iterations within them, so they are the unit that counts. Before the
declared starts a verdict ends a run only with room for what the run may not have met
(`r2bspec.judge.unmet`). With fewer than five starts, a run too often misses one of the two speeds
of a graph that has two: if half of the starts are 10 % slower, a mean would fail wrongly in 12 % of
runs that may end after three without room. A run of one start is judged at its end; if it may be
extended (`max_iterations`), after 1, 2 and 4 times the declared iterations, too.

A run that is judged again and again until it passes is bound to pass in the end: three unplanned
looks at the 95 % level pass one bad graph in ten. Room costs more than a look could gain, so that
looks before the declared starts take next to nothing of the error alpha = 1 - confidence; each is
made at 0.7 alpha. Those that extend a run share it with the look at the declared starts. Most of it
is left for the last of L looks, so that a long run decides nearly what it would if it were judged
once:

                              the last        each of the others
    after a start             0.7 alpha       alpha L^(-1.1)
    in a run of one start     alpha / 2       alpha / (2 (L - 1))

Pairs of runs are judged when all are played and, after a FAIL, again with those that confirm it;
the second look has an eighth of the error, so that at most 1 % of equal graphs fail both.

The first is calibrated: for Student's t on normal values, all looks together are wrong in 5.0 % at
most, each way (`tests/simulation/test_simulation_looks.py`); so are the constant levels of Pocock
(1977) for a known deviation. The second needs no assumption about the test: by Boole's inequality
the chance that any look is wrong is at most the sum, alpha.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.plan.plan import PlayPlan

LOOK_FACTORS: Final = (1, 2, 4)
"""Of the declared iterations, in a run of one start."""

_SHARE_BY_TURNS: Final = 0.3
"""Of the error, for each look at starts of both sides. Pairs share most of their values from look
to look, so that the sum is not used up (`tests/simulation/test_simulation_turns.py`)."""

_SHARES_OF_PAIRS: Final = (1.0, 0.125)
"""Of the error, for all pairs, and for these with those that confirm a failure."""

FIRST_LOOK: Final = 3
"""After so many starts; fewer are judged only at the end of a run that has no more."""

_EARLY_SHARE: Final = 0.7
"""Of the error, for each look before the declared starts, which needs room."""

FIRST_LOOK_BY_TURNS: Final = 5


def pairs_that_confirm(failed: int) -> int:
    """Return how many fresh pairs are played after `failed` pairs have failed."""
    return max(3, failed // 2)


MAX_LOOKS: Final = 20
"""With more, each would have too little of the error to decide anything."""


def iterations_of_starts(iterations: int, starts: int, most: int = 0) -> tuple[range, ...]:
    """Return the iterations of each start, from 1: parts as equal as possible, larger first.

    Those above the declared number are played in further starts, which have as many iterations as
    the first starts, or up to twice as many if the rest does not suffice for another start. A run
    of one start keeps it.

    Args:
        iterations: the declared number at each rate.
        starts: for these, at least 1; those without an iteration are left out.
        most: to how many iterations the run may be extended; `iterations` if that is more.
    """
    further = max(0, most - iterations)
    if starts == 1 or not further:
        return _equal_parts(0, iterations + further, starts)
    declared = _equal_parts(0, iterations, starts)
    return declared + _equal_parts(iterations, further, max(1, further * starts // iterations))


def _equal_parts(before: int, number: int, parts: int) -> tuple[range, ...]:
    size, rest = divmod(number, parts)
    ends = [before + part * size + min(part, rest) for part in range(parts + 1)]
    return tuple(range(first + 1, end + 1) for first, end in pairwise(ends) if end > first)


@dataclass(frozen=True)
class InterimLooks:
    """The numbers of iterations after which a run is judged, ascending; at least one.

    Attributes:
        declared: the declared number of iterations: before it, a run ends only with a decision.
        after_starts: whether the looks come after starts.
        shares: for a comparison, the part of the error that each look may use; the looks after a
            FAIL confirm it. Empty for a run.
    """

    iterations: tuple[int, ...]
    declared: int = 0
    after_starts: bool = False
    shares: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        ends = (0, *self.iterations)
        if not self.iterations or any(b <= a for a, b in pairwise(ends)):
            raise ValueError("looks are planned at one or more ascending numbers of iterations")

    @classmethod
    def planned(cls, iterations: int, starts: int = 1, most: int = 0) -> InterimLooks:
        """Return the looks of a run.

        Args:
            iterations: the declared number at each rate.
            starts: for these.
            most: to how many iterations the run may be extended; `iterations` if that is more.
        """
        most = max(iterations, most)
        if starts == 1:
            ends = {min(iterations * factor, most) for factor in LOOK_FACTORS}
        else:
            parts = iterations_of_starts(iterations, starts, most)
            parts = parts[FIRST_LOOK - 1 :]
            ends = {part[-1] for part in parts[:: max(1, -(-len(parts) // (MAX_LOOKS - 1)))]}
            ends |= {iterations}
        return cls(tuple(sorted(ends | {most})), declared=iterations, after_starts=starts > 1)

    @classmethod
    def of_plays(cls, plays: Sequence[PlayPlan], starts: int) -> InterimLooks | None:
        """Return the looks at some plays.

        None if they are judged once, or nothing is played.
        """
        looks = cls.with_end(plays, starts) if plays else None
        return looks if looks is not None and len(looks) > 1 else None

    @classmethod
    def with_end(cls, plays: Sequence[PlayPlan], starts: int) -> InterimLooks:
        """Return the looks at some plays, at least one; the last look is at the end."""
        longest = max(plays, key=lambda play: play.iterations)
        return cls.planned(longest.iterations, starts, longest.max_iterations)

    @classmethod
    def after_pairs(cls, failed: int, all_: int) -> InterimLooks:
        """Return the looks at pairs of runs: at the failed pairs, and at all with confirmation."""
        return cls((failed, all_), declared=failed, shares=_SHARES_OF_PAIRS)

    @classmethod
    def after_starts_of_both(
        cls, starts: int, declared: int, confirmed_from: int = 0
    ) -> InterimLooks:
        """Return the looks at a comparison by turns.

        Args:
            starts: the largest number of starts of both sides.
            declared: the iterations of the head's spec; each start plays one of each side.
            confirmed_from: the look that failed; the next one is at the end.
        """
        last = confirmed_from or starts
        ends = tuple(sorted({*range(FIRST_LOOK_BY_TURNS, last), last, starts}))
        shares = (_SHARE_BY_TURNS,) * len(ends)
        return cls(ends, declared=min(declared, starts), after_starts=True, shares=shares)

    def __len__(self) -> int:
        return len(self.iterations)

    def error_share(self, look: int) -> float:
        """Return the part of the error that a look may make; looks are counted from 1."""
        if self.shares:
            return self.shares[look - 1]
        sharing = sum(end >= self.declared for end in self.iterations)
        if self.iterations[look - 1] < self.declared:
            return _EARLY_SHARE
        if sharing == 1:
            return 1.0
        if self.after_starts:
            return 0.7 if look == len(self) else sharing**-1.1
        return 1 / 2 if look == len(self) else 1 / (2 * (sharing - 1))

    def confidence_at(self, look: int, confidence: float = CONFIDENCE) -> float:
        """Return the confidence at which a look decides, for decisions of a given confidence."""
        return 1 - (1 - confidence) * self.error_share(look)

    def completed_looks(self, iterations: int) -> int:
        """Return how many looks a number of complete iterations allows; 0 before the first."""
        return sum(end <= iterations for end in self.iterations)
