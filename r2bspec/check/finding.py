"""What a rule finds: a problem at a path of the spec, before it has a line and a column."""

from __future__ import annotations

from collections.abc import Iterator, Set
from dataclasses import dataclass
from typing import Literal

from r2bspec.diagnostics.diagnostic import Path

SeverityName = Literal["error", "warning", "info"]
"""A `r2bspec.diagnostics.diagnostic.Severity`, as rules write it."""


@dataclass(frozen=True, slots=True)
class Pointer:
    """Another value of the spec that explains a finding; `key` means its key."""

    message: str
    path: Path
    key: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One problem.

    Attributes:
        message: one sentence without a full stop; names are in single quotes.
        path: the value that is wrong.
        key: whether the key there is wrong, rather than the value.
        part: offset and length, in characters of the value's text, of the piece that is wrong.
        help: the way out.
        related: other places that explain it.
        replacement: a text that may safely stand in place of the value, or of its `part`.
        severity: if not the rule's own.
        machine_dependent: whether another machine may find otherwise.
        code: if not the rule's own, as for errors of the data.
        suppressed_by: the subjects that the finding is a statement about; see
        `r2bspec.check.engine`. suppresses: the subjects about which nothing more needs to be said
        once this is known.
    """

    message: str
    path: Path
    key: bool = False
    part: tuple[int, int] | None = None
    help: str = ""
    related: tuple[Pointer, ...] = ()
    replacement: str | None = None
    severity: SeverityName | None = None
    machine_dependent: bool = False
    code: str = ""
    suppressed_by: Set[str] = frozenset()
    suppresses: Set[str] = frozenset()


Findings = Iterator[Finding]
"""What a rule yields."""
