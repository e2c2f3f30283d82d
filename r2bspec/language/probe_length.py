"""How long the probe of a rate lasts at most, and when it may end early because it is decided."""

from __future__ import annotations

from typing import Final

from r2bspec.language.quantities import Duration

PROBE: Final = Duration(10 * 10**9)
"""The longest duration of the probe of one rate, by default."""

CONFIRM: Final = Duration(30 * 10**9)
"""How long the lower end of the bracket is played, by default."""

OVERLOAD_PROBES: Final = 6
"""The graph is overloaded for at most as long as so many probes."""

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
