"""The options of a check, and what it says of one file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from r2bspec.diagnostics import Diagnostic

if TYPE_CHECKING:
    from r2bspec.language.environment_access import UntrustedSpecs


class CheckOptions(msgspec.Struct, frozen=True):
    """The options for every file."""

    sets: tuple[str, ...] = ()
    variables: Mapping[str, str] | None = None
    case: str = ""
    allow_paths: tuple[Path, ...] = ()
    untrusted: UntrustedSpecs | None = None
    offline: bool = False
    resolved: bool = False
    require_slos: bool = False


class FileReport(msgspec.Struct, frozen=True):
    """One file after its check.

    Attributes:
        file: its name for the user.
        cases: the number of checked cases; 1 without a matrix.
        complete: whether all rules were applied, which needs a well-formed document.
        findings: all findings, sorted by place.
        texts: the texts that the findings refer to, by file name.
        resolved: if requested, every case with all substitutions done, by the file's name and the
            case.
    """

    file: str
    cases: int
    complete: bool
    findings: tuple[Diagnostic, ...]
    texts: Mapping[str, str]
    resolved: Mapping[str, str] = msgspec.field(default_factory=dict)
