"""The actions that an editor offers for the findings of a spec: their safe edits, and waivers.

Cases of specs, which a test explorer shows, have a request of their own.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from lsprotocol import types

from r2bspec.diagnostics import Diagnostic, Severity, did_you_mean
from r2bspec.diagnostics.code_pages import find_page
from r2bspec.diagnostics.diagnostic import Edit
from r2bspec.diagnostics.edits import applicable_together
from r2bspec.diagnostics.waivers import NOT_WAIVABLE
from r2bspec.language.load_spec import load_cases
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.findings import PositionsOf, is_file, to_diagnostic, uri
from r2bspec.language_server.positions import TextPositions
from r2bspec.safe_io.safe_file import unsaved_files

CASES_REQUEST: Final = "r2bspec/cases"
"""The request of the protocol: its parameters are ``{"uri": ...}`` of a spec."""


def spec_cases(path: Path, text: str, unsaved: Mapping[Path, str]) -> list[dict[str, Any]]:
    """Return the cases of a text; of a text with errors, as far as they can be determined.

    Each has the name of the benchmark with its case, the case as ``--case`` takes it, and the line
    of the name in the spec, from 0.

    Args:
        path: the path of the file, absolute.
        text: of the document, saved or not.
        unsaved: the texts of open files, which take the place of what is on disk.
    """
    with unsaved_files(unsaved):
        cases = load_cases(text, file=str(path))
    rows = []
    for loaded in cases:
        place = loaded.span(("name",), key=True)
        # The name of the benchmark may be in an extended file.
        line = place.line - 1 if place.file == str(path) else 0
        rows.append({"name": loaded.id, "case": loaded.case, "line": max(line, 0)})
    return rows


def _edits(file: str, *edits: types.TextEdit) -> types.WorkspaceEdit:
    return types.WorkspaceEdit(changes={uri(file): [*edits]})


_UNREADABLE = ("R2B0", "R2B1")
"""Errors of these codes leave no spec, and cannot be waived."""


def code_actions(
    analysis: Analysis, positions_of: PositionsOf, where: types.Range
) -> list[types.CodeAction]:
    """Return the actions for the findings in a range, and that for all of them."""
    positions = positions_of(str(analysis.path))
    start, end = positions.offset(where.start), positions.offset(where.end)
    here = [
        diagnostic
        for diagnostic in analysis.diagnostics
        if diagnostic.span.file == str(analysis.path)
        and _overlaps(positions, diagnostic, start, end)
    ]
    return [
        *_fixes(here, positions_of),
        *_waivers(analysis, here, positions_of),
        *_fix_all(analysis, positions_of),
    ]


def _overlaps(positions: TextPositions, diagnostic: Diagnostic, start: int, end: int) -> bool:
    first, last = positions.offsets(diagnostic.span)
    return first <= end and start <= last


def _fixes(here: Sequence[Diagnostic], positions_of: PositionsOf) -> Iterator[types.CodeAction]:
    for finding in here:
        edit = finding.edit or _meant(finding, positions_of)
        if edit is None:
            continue
        span, text = edit.span, edit.text
        yield types.CodeAction(
            title=f"Replace with '{text}'" if text.strip() else "Remove it",
            kind=types.CodeActionKind.QuickFix,
            diagnostics=[to_diagnostic(finding, finding.span.file, positions_of)],
            is_preferred=True,
            edit=_edits(span.file, types.TextEdit(positions_of(span.file).range(span), text)),
        )


_MEANT: Final = re.compile(r"^did you mean '([^']+)'\?")


def _meant(diagnostic: Diagnostic, positions_of: PositionsOf) -> Edit | None:
    """Return the name that a finding proposes in place of what it is at, if that is the wrong name.

    It is a guess, which a person may choose and nothing else applies.
    """
    match = _MEANT.match(diagnostic.help)
    if (
        match is None
        or not is_file(diagnostic.span.file)
        or diagnostic.span.line != diagnostic.span.end_line
    ):
        return None
    positions = positions_of(diagnostic.span.file)
    start, end = positions.offsets(diagnostic.span)
    written = positions.text[start:end]
    quote = written[:1] if written[:1] in {"'", '"'} else ""
    if did_you_mean(written.strip("'\""), [match[1]]) != match[1]:
        return None
    return Edit(diagnostic.span, f"{quote}{match[1]}{quote}")


def _fix_all(analysis: Analysis, positions_of: PositionsOf) -> Iterator[types.CodeAction]:
    positions = positions_of(str(analysis.path))
    edits = [diagnostic.edit for diagnostic in analysis.diagnostics if diagnostic.edit is not None]
    own = (edit for edit in edits if edit.span.file == str(analysis.path))
    changes = [
        types.TextEdit(positions.range(edit.span), edit.text)
        for edit in applicable_together(positions.text, own)
    ]
    if changes:
        yield types.CodeAction(
            title="Apply all safe fixes of this file",
            kind=types.CodeActionKind.SourceFixAll,
            edit=_edits(str(analysis.path), *changes),
        )


def _waivers(
    analysis: Analysis, here: Sequence[Diagnostic], positions_of: PositionsOf
) -> Iterator[types.CodeAction]:
    positions = positions_of(str(analysis.path))
    for finding in here:
        unreadable = finding.severity is Severity.ERROR and finding.code.startswith(_UNREADABLE)
        if unreadable or finding.code == NOT_WAIVABLE:
            continue
        start, _ = positions.line_at(positions.offsets(finding.span)[0])
        page = find_page(finding.code)
        name = page.slug if page is not None else finding.code
        line = positions.text[start:]
        indent = line[: len(line) - len(line.lstrip(" "))]
        comment = f"{indent}# r2bspec: ignore[{name}] TODO: why this is intended\n"
        edit = types.TextEdit(positions.range_of_offsets(start, start), comment)
        yield types.CodeAction(
            title=f"Waive {finding.code} here, with a reason",
            kind=types.CodeActionKind.QuickFix,
            diagnostics=[to_diagnostic(finding, finding.span.file, positions_of)],
            edit=_edits(str(analysis.path), edit),
        )
