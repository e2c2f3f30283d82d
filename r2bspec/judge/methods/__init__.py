"""The methods by which requirements are decided: their names and traits.

A module of this package takes a case and returns a decision. To add a method, add its function to
`method_of` of `r2bspec.judge.pipeline`, and its entries here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

Method = Literal[
    "exact binomial",
    "t over iterations",
    "paired t on logs",
    "trimmed t by turns",
    "observation",
    "search bracket",
    "sequential probe",
    "none",
]
"""How a requirement was decided. ``none``: without a test, for lack of samples."""


@dataclass(frozen=True, slots=True)
class MethodTraits:
    """What the rest of the program needs to know about a method.

    Attributes:
        grows: whether more iterations can help it to a decision.
        rests_on: what has to be measured again to confirm its FAIL.
    """

    grows: bool = False
    rests_on: Literal["iterations", "search", "probes"] = "iterations"


METHODS: Final[dict[Method, MethodTraits]] = {
    "exact binomial": MethodTraits(grows=True),
    "t over iterations": MethodTraits(grows=True),
    "paired t on logs": MethodTraits(grows=True),
    "trimmed t by turns": MethodTraits(grows=True),
    "observation": MethodTraits(),
    "search bracket": MethodTraits(rests_on="search"),
    "sequential probe": MethodTraits(rests_on="probes"),
    "none": MethodTraits(),
}
