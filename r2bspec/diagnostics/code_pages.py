"""The pages of `r2bspec explain`: one for each code."""

from __future__ import annotations

import msgspec

from r2bspec.diagnostics.diagnostic import Severity

FAMILIES = {
    "0": "The file and its YAML",
    "1": "The language",
    "2": "Names and types in the graph",
    "3": "Recorded data",
    "4": "Playback and monitors",
    "5": "Rates and requirements",
    "6": "Files, this machine, and the run",
    "7": "Scripts and launch files",
}
"""The family of a code, by its first digit."""


class Page(msgspec.Struct, frozen=True):
    """The explanation of one diagnostic code.

    Attributes:
        slug: the name of the code in words, such as ``unknown-key``: unique, in kebab case.
        code: such as ``R2B204``.
        title: the problem in a few words, without a full stop.
        severity: the default severity of its findings.
        why: one or two sentences on the consequences of the problem, or the rule behind it.
        failing: YAML with the problem; a whole spec or the relevant part. May be empty.
        passing: the same without the problem. May be empty.
    """

    slug: str
    code: str
    title: str
    severity: Severity
    why: str
    failing: str
    passing: str
