"""How many starts of its processes a run has, if the spec does not say.

Runs of one graph differ by more than the iterations of a run show: memory layout, the order of
discovery and the placement of threads are decided anew at each start. So a run is a sample of
starts, and a verdict about the graph needs several (Kalibera and Jones, ISMM 2013).
"""

from __future__ import annotations

from typing import Final

DEFAULT_STARTS: Final = 5
"""As many as a run has if it has iterations enough."""

MAX_STARTS: Final = 1000
"""The most that a spec can ask for."""

MIN_ITERATIONS: Final = 2
"""The fewest iterations of a start: with one, starts and iterations could not be told apart."""


def default_starts(iterations: int) -> int:
    """The number of starts for a number of iterations at each rate; at least 1."""
    return max(1, min(DEFAULT_STARTS, iterations // MIN_ITERATIONS))
