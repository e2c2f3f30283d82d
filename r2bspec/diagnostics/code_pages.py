"""What `r2bspec explain CODE` says: one page for each code."""

from __future__ import annotations

from dataclasses import dataclass

from r2bspec.diagnostics.diagnostic import Severity

FAMILIES = {
    "0": "The file and its YAML",
    "1": "The language",
    "2": "Names and types in the graph",
    "3": "Recorded data",
    "4": "Playback and monitors",
    "5": "What is played and what must hold",
    "6": "Files, this machine, and the run",
}
"""What the first digit of a code says."""


@dataclass(frozen=True, slots=True)
class Page:
    """The explanation of one diagnostic code.

    Attributes:
        slug: the name of the code in words, such as ``unknown-key``: unique, in kebab case.
        code: such as ``R2B204``.
        title: what is wrong, in a few words, without a full stop.
        severity: how bad a finding of this code is by default.
        why: one or two sentences: what would go wrong if it were let through.
        failing: YAML that leads to this code; a whole spec or the part that matters.
        passing: the same, put right.
    """

    slug: str
    code: str
    title: str
    severity: Severity
    why: str
    failing: str
    passing: str
