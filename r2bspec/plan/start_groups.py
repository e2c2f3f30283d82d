"""Which iterations are played in which start of the processes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise


def iterations_of_starts(iterations: int, starts: int) -> tuple[range, ...]:
    """The iterations of each start, counted from 1: as equal parts as possible, larger ones first.

    Args:
        iterations: their number at each rate.
        starts: at least 1; those without an iteration are left out.
    """
    each, rest = divmod(iterations, starts)
    ends = [number * each + min(number, rest) for number in range(starts + 1)]
    return tuple(range(first + 1, end + 1) for first, end in pairwise(ends) if end > first)


def iterations_by_look(looks: Sequence[int], starts: int) -> tuple[tuple[range, ...], ...]:
    """The iterations of each start, in groups between two interim looks.

    A look comes after whole starts: the iterations that follow it are played in further starts,
    which have as many iterations as the first ones, or up to twice as many where the rest does not
    suffice for another start. A run that has one start keeps it.

    Args:
        looks: after how many iterations the run is judged, ascending; at least one.
        starts: up to the first look, at least 1.

    Returns:
        For each look, the ranges of iterations, of one start each.
    """
    if starts == 1:
        return tuple((range(first + 1, end + 1),) for first, end in pairwise((0, *looks)))
    groups = [iterations_of_starts(looks[0], starts)]
    for before, end in pairwise(looks):
        further = max(1, (end - before) * starts // looks[0])
        groups.append(
            tuple(
                range(before + each.start, before + each.stop)
                for each in iterations_of_starts(end - before, further)
            )
        )
    return tuple(groups)
