"""Every method by which a requirement is decided: its name, its traits, and who decides by it.

Another method is a module of this package with a `DECIDER`, and its entries here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

Method = Literal[
    "exact binomial",
    "binomial over windows",
    "t over iterations",
    "paired t on logs",
    "prediction interval",
    "stored baseline",
    "observation",
    "search bracket",
    "sequential probe",
    "none",
]
"""How a requirement was decided. ``none``: there was nothing to decide it by."""


@dataclass(frozen=True, slots=True)
class MethodTraits:
    """What the rest of the program has to know of a method.

    Attributes:
        grows: whether more iterations can bring it to a decision.
        rests_on: what has to be measured again to confirm its FAIL.
    """

    grows: bool = False
    rests_on: Literal["iterations", "search", "probes"] = "iterations"


METHODS: Final[dict[Method, MethodTraits]] = {
    "exact binomial": MethodTraits(grows=True),
    "binomial over windows": MethodTraits(grows=True),
    "t over iterations": MethodTraits(grows=True),
    "paired t on logs": MethodTraits(grows=True),
    "prediction interval": MethodTraits(),
    "stored baseline": MethodTraits(),
    "observation": MethodTraits(),
    "search bracket": MethodTraits(rests_on="search"),
    "sequential probe": MethodTraits(rests_on="probes"),
    "none": MethodTraits(),
}

DECIDERS: Final = (
    "peak_bracket",
    "sustained",
    "window_share",
    "percentile_bound",
    "share_bound",
    "mean_bound",
    "observation",
)
"""The modules that decide requirements on one run: the first that takes a requirement decides it.
Ratios to a baseline are decided by `r2bspec.judge.baseline_ratio`."""
