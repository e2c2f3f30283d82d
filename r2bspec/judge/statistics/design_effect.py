"""By how much a count of bad messages scatters more than a binomial one.

The binomial test takes messages to be independent. They are not: a stall makes successive messages
late, and an iteration, or a start of the graph's processes, may be worse than the others. The count
then scatters more than a binomial one by a factor F, the design effect, and k bad ones of n
messages are tested as k / F of n / F.

With k_1 .. k_m bad messages in m pieces, V is the variance of these counts over the binomial one.
It is known from m values only, so the quantiles of t take the place of the normal ones:

    F = V (t_c(m - 1) / z_c)^2,    at least 1,    c the confidence of the decision.

F is the largest value over the starts and over the iterations, where there are at least two (a run
is a hierarchical sample: Kalibera and Jones, "Rigorous benchmarking in reasonable time", ISMM
2013). A single iteration is cut into ten stretches.

If pieces differ by a factor, the variance of their shares rises with p^2: a run that by chance had
its better starts would also look uniform. So where p = k / n is nearer to 0 or 1 than the allowed
share p_0, and V exceeds 1, its excess V - 1 is multiplied by

    p_0 (1 - p_0) / (p (1 - p)),    at most 4.

F does not depend on the order of the pieces. Without bad messages F is 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.statistics.t_interval import by_start
from r2bspec.language.benchmark_defaults import CONFIDENCE

_Scalar = TypeVar("_Scalar", bound=np.generic)

Pieces = Literal["", "stretches", "iterations", "starts"]

BadFlags = NDArray[np.bool_]
"""Which messages of an iteration are bad, in the order of the steps; shape (n,)."""

_STRETCHES: Final = 10
_MIN_PIECES: Final = 2
_MAX_EXCESS_RATIO: Final = 4.0


@dataclass(frozen=True)
class SampleDesign:
    """How a sample came about, and which share is tested.

    Attributes:
        starts: the start of each iteration; empty where all belong to the same start.
        allowed: the share that is tested; None if only the observed share matters.
        confidence: of the decision.
    """

    starts: tuple[int, ...] = ()
    allowed: float | None = None
    confidence: float = CONFIDENCE


ONE_START: Final = SampleDesign()


@dataclass(frozen=True)
class EffectiveSample:
    """A number of messages and its design effect.

    Attributes:
        n: messages.
        bad: bad messages among them.
        effect: F, at least 1.
        differ: the pieces whose scatter makes F larger than 1; empty if none does.
    """

    n: int
    bad: int
    effect: float = 1.0
    differ: Pieces = ""

    @property
    def messages(self) -> float:
        """Return the effective sample size n / F."""
        return self.n / self.effect

    @property
    def bad_messages(self) -> float:
        """Return the bad messages in the effective sample, k / F."""
        return self.bad / self.effect


def effective_sample(
    iterations: Sequence[BadFlags], design: SampleDesign = ONE_START
) -> EffectiveSample:
    """Return the effective sample of the messages of some iterations.

    Args:
        iterations: one array for each iteration.
        design: their starts, and which share is tested.
    """
    levels = pieces_of_levels(iterations, design.starts)
    counts = {
        differ: np.array([np.count_nonzero(piece) for piece in pieces])
        for differ, pieces in levels.items()
    }
    sizes = {
        differ: np.array([piece.size for piece in pieces]) for differ, pieces in levels.items()
    }
    return sample_of_counts(counts, sizes, design)


def pieces_of_levels(
    iterations: Sequence[NDArray[_Scalar]], starts: Sequence[int]
) -> dict[Pieces, list[NDArray[_Scalar]]]:
    """Return the messages of iterations and starts, or of the stretches of a single iteration."""
    kept = [row for row in iterations if row.size]
    numbers = [start for start, row in zip(starts, iterations, strict=False) if row.size]
    if len(kept) == 1:
        return {"stretches": np.array_split(kept[0], min(_STRETCHES, kept[0].size))}
    if len(set(numbers)) < _MIN_PIECES:
        return {"iterations": kept}
    of_starts = [np.concatenate(group) for group in by_start(kept, numbers)]
    return {"iterations": kept, "starts": of_starts}


def sample_of_counts(
    counts: Mapping[Pieces, NDArray[np.int64]],
    sizes: Mapping[Pieces, NDArray[np.int64]],
    design: SampleDesign,
) -> EffectiveSample:
    """Return the effective sample by the bad messages, and all messages, of each piece."""
    first = next(iter(counts))
    n, bad = int(sizes[first].sum()), int(counts[first].sum())
    if not 0 < bad < n:
        return EffectiveSample(n, bad)
    effects = {differ: _level_effect(counts[differ], sizes[differ], design) for differ in counts}
    differ = max(effects, key=effects.__getitem__)
    # Digits that the order of additions decides are cut off. One message remains at least.
    effect = min(round(effects[differ], 6), float(n))
    if effect <= 1:
        return EffectiveSample(n, bad)
    return EffectiveSample(n, bad, effect, differ)


def _level_effect(
    counts: NDArray[np.int64], sizes: NDArray[np.int64], design: SampleDesign
) -> float:
    """Return F by the scatter of the shares of some pieces."""
    m = sizes.size
    if m < _MIN_PIECES:
        return 1.0
    p = float(counts.sum() / sizes.sum())
    variance = float((sizes * (counts / sizes - p) ** 2).sum()) / (m - 1) / (p * (1 - p))
    excess = max(0.0, variance - 1) * (_excess_ratio(p, design.allowed) - 1)
    return (variance + excess) * _small_sample_factor(m - 1, design.confidence)


def _excess_ratio(p: float, allowed: float | None) -> float:
    """Return by how much larger the excess is at the allowed share than at the observed share."""
    if allowed is None or not 0 < allowed < 1:
        return 1.0
    return min(max(allowed * (1 - allowed) / (p * (1 - p)), 1.0), _MAX_EXCESS_RATIO)


@cache
def _small_sample_factor(freedom: int, confidence: float) -> float:
    """Return (t_c(freedom) / z_c)^2."""
    from scipy.special import ndtri, stdtrit

    return float(stdtrit(freedom, confidence) / ndtri(confidence)) ** 2
