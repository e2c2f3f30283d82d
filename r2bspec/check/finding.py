"""What a rule finds: a problem at a path of the spec, before it has a line and a column."""

from __future__ import annotations

from collections.abc import Iterator, Set
from typing import Literal

import msgspec

from r2bspec.diagnostics.diagnostic import Path

SeverityName = Literal["error", "warning", "info"]
"""A `r2bspec.diagnostics.diagnostic.Severity`, as rules write it."""


class Pointer(msgspec.Struct, frozen=True):
    """Another place of the spec that explains a finding: the value at `path`, or its key."""

    message: str
    path: Path
    key: bool = False


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """One problem.

    Attributes:
        message: what is wrong, without a full stop; names are in single quotes.
        path: the wrong value.
        key: whether the key at `path` is wrong, not the value.
        part: offset and length of the wrong part, in characters of the value's text.
        help: what to do.
        related: other places that explain it.
        replacement: a text that can safely replace the value, or its `part`.
        severity: if it differs from the rule's.
        machine_dependent: whether the result may differ on another machine.
        code: if it differs from the rule's, as for errors of bags.
        suppressed_by: the subjects of the finding; see `r2bspec.check.engine`.
        suppresses: the subjects that this finding explains.
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
"""The result of a rule."""
