"""The cases of a spec, for the test explorer of an editor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from r2bspec.language.load_spec import load_cases
from r2bspec.untrusted.unsaved_files import unsaved_files

REQUEST: Final = "r2bspec/cases"
"""The request of the protocol: its parameters are ``{"uri": ...}`` of a spec."""


@dataclass(frozen=True, slots=True)
class SpecCase:
    """One case, as it is sent.

    Attributes:
        name: of the benchmark with its case, as results have it.
        case: of the matrix, as ``--case`` takes it; empty without one.
        line: of the name in the spec, from 0.
    """

    name: str
    case: str
    line: int


def spec_cases(path: Path, text: str, unsaved: Mapping[Path, str]) -> list[SpecCase]:
    """The cases of a text; of one with errors those that can be told.

    Args:
        path: of the file, absolute.
        text: of the document, saved or not.
        unsaved: the texts of open files, which take the place of what is on disk.
    """
    with unsaved_files(unsaved):
        cases = load_cases(text, file=str(path))
    found = []
    for loaded in cases:
        place = loaded.span(("name",), key=True)
        # The name of the benchmark may be in an extended file.
        line = place.line - 1 if place.file == str(path) else 0
        found.append(SpecCase(loaded.id, loaded.case, max(line, 0)))
    return found
