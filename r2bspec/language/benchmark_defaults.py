"""The defaults of a benchmark: its confidence, its starts, its probes.

Runs of one graph differ by more than the iterations of a run show: memory layout, the order of
discovery and the placement of threads are decided anew at each start. So a run is a sample of
starts, and a verdict about the graph needs several (Kalibera and Jones, ISMM 2013).
"""

from __future__ import annotations

from typing import Final

from r2bspec.language.quantities import Duration

CONFIDENCE: Final = 0.95
"""One-sided each way: PASS and FAIL are each wrong in at most 5 % of runs."""
MIN_CONFIDENCE: Final = 0.51
"""At 50 % a verdict is as good as a coin toss; close to that, quantiles divide by nearly 0."""

CONFIRMATION_CONFIDENCE: Final = 0.9
"""The confidence at which a second run confirms a failure (`r2bspec.judge.confirmation`)."""


DEFAULT_STARTS: Final = 5
"""As many as a run has if it has iterations enough."""

MAX_STARTS: Final = 1000
"""The most that a spec can ask for."""

LEAST_STARTS: Final = 3
"""The fewest of several starts: of two, the difference tells next to nothing of how starts vary,
and a verdict on two is more often open than on one."""

MIN_ITERATIONS: Final = 2
"""The fewest iterations of a start: with one, starts and iterations could not be told apart."""


def default_starts(iterations: int) -> int:
    """Return the number of starts for a number of iterations at each rate: 1, or at least three."""
    starts = min(DEFAULT_STARTS, iterations // MIN_ITERATIONS)
    return starts if starts >= LEAST_STARTS else 1


PROBE: Final = Duration(10 * 10**9)
"""The longest duration of the probe of one rate, by default."""

CONFIRM: Final = Duration(30 * 10**9)
"""How long the lower end of the bracket is played, by default."""

OVERLOAD_PROBES: Final = 6
"""The graph is overloaded for at most as long as so many probes."""

SEARCH_PROBES: Final = 12
SEARCH_CONFIRMATIONS: Final = 3
"""A whole search lasts as long as so many probes and so many whole plays; after that only what a
bracket needs is played."""

MAX_LONGER: Final = 6
"""At low rates, what must show that few messages are lost lasts up to so many times as long."""

MIN_PROBE_STEPS: Final = 20
"""A probe of a low rate lasts longer: for so many steps."""

FIRST_LOOK_S: Final = 1.0
LOOKS_RATIO: Final = 1.5
"""A probe is judged at the first look, and then each time its duration has grown by the ratio: it
ends as soon as it is decided."""

MIN_LOOK_MESSAGES: Final = 20
"""With fewer messages nothing is judged, unless the probe is over."""

MAX_NO_OUTPUT_S: Final = 2.0
"""A graph without output for so long does not keep up: it had output during the warm-up. Waiting
for the end of the probe would only make the search longer."""
