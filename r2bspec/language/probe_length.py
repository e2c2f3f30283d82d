"""How long the probe of a rate lasts: at the longest, and until it may end because it is clear."""

from __future__ import annotations

from typing import Final

from r2bspec.language.quantities import Duration

PROBE: Final = Duration(10 * 10**9)
"""The longest time for which one rate is tried, where a spec states no other."""

MIN_PROBE_STEPS: Final = 20
"""A probe of a low rate lasts longer than that, for as many steps."""

FIRST_LOOK_S: Final = 1.0
LOOKS_RATIO: Final = 1.5
"""A probe is judged after the time of the first look, and after each that is longer by the ratio:
it ends as soon as its answer is clear."""

MIN_LOOK_MESSAGES: Final = 20
"""With fewer messages nothing is judged, unless the probe is over."""

MAX_NO_OUTPUT_S: Final = 2.0
"""A graph that has answered nothing for so long will not have kept up when it does: it answered
during the warm-up. To wait for the end of the probe would only make a search for nothing long."""
