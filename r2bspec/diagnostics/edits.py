"""Applying edits to a text.

Only the characters in the span of an edit change; comments, quotes, blank lines and line ends are
kept. If edits overlap, one of them is applied; the others are left for the next round, if their
findings are still present then.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from r2bspec.diagnostics.diagnostic import LINE_BREAK, Diagnostic, Edit, Severity, Span

MAX_ROUNDS = 20
"""Rounds of editing and checking. Each round fixes at least one finding, so few are needed."""

_LINE = re.compile(r"[^\n]*\n|[^\n]+")  # lines as patch splits them, unlike YAML
_PARSE_ERROR_CODE = re.compile(r"R2B0(?:0[1-3]|1\d|2[0-2])$")


@dataclass(frozen=True, slots=True)
class FixResult:
    """A text after its edits.

    Attributes:
        text: the edited text; the original if there was no edit to apply.
        applied: the findings whose edits were applied, in the order of the rounds.
    """

    text: str
    applied: tuple[Diagnostic, ...]


def fix(text: str, file: str, findings_of: Callable[[str], Sequence[Diagnostic]]) -> FixResult:
    """Apply safe edits and check again, until there is no edit left.

    Args:
        text: the text of the document.
        file: its name in spans; edits of other files are ignored.
        findings_of: the findings in a text with that name.
    """
    findings = findings_of(text)
    applied: list[Diagnostic] = []
    texts = {text}
    for _ in range(MAX_ROUNDS):
        offered = [finding.edit for finding in findings if finding.edit is not None]
        chosen = _non_overlapping(text, (edit for edit in offered if edit.span.file == file))
        edited = _spliced(text, chosen)
        if edited in texts:
            break
        after = findings_of(edited)
        if _unreadable(after) and not _unreadable(findings):
            break  # never make a document unreadable
        edits = {edit for _, edit in chosen}
        applied += [finding for finding in findings if finding.edit in edits]
        texts.add(edited)
        text, findings = edited, after
    return FixResult(text, tuple(applied))


def apply_edits(text: str, edits: Iterable[Edit]) -> str:
    """Return the text after the edits.

    If edits overlap or touch, only the first is applied.
    """
    return _spliced(text, _non_overlapping(text, edits))


def applicable_together(text: str, edits: Iterable[Edit]) -> list[Edit]:
    """Return the edits that `apply_edits` applies, in the order of their places."""
    return [edit for _, edit in _non_overlapping(text, edits)]


def unified_diff(before: str, after: str, file: str) -> str:
    """Return the unified diff of two texts; empty if they are equal."""
    import difflib

    name = file.lstrip("/")
    lines = difflib.unified_diff(
        _LINE.findall(before), _LINE.findall(after), f"a/{name}", f"b/{name}"
    )
    missing = "\\ No newline at end of file\n"
    return "".join(line if line.endswith("\n") else f"{line}\n{missing}" for line in lines)


def _spliced(text: str, edits: Iterable[tuple[tuple[int, int], Edit]]) -> str:
    parts: list[str] = []
    done = 0
    for (start, end), edit in edits:
        parts += [text[done:start], edit.text]
        done = end
    return "".join([*parts, text[done:]])


def _non_overlapping(text: str, edits: Iterable[Edit]) -> list[tuple[tuple[int, int], Edit]]:
    """Edits that can be applied together, each with the offsets of the text it replaces."""
    starts = [0, *(match.end() for match in LINE_BREAK.finditer(text))]
    placed = [
        (place, offered_edit)
        for offered_edit in set(edits)
        if (place := _offsets(offered_edit.span, starts, text))
    ]
    placed.sort(key=lambda placed_edit: (placed_edit[0], placed_edit[1].text))
    chosen: list[tuple[tuple[int, int], Edit]] = []
    last = -1
    for place, edit in placed:
        if place[0] > last:
            chosen.append((place, edit))
            last = place[1]
    return chosen


def _offsets(span: Span, starts: Sequence[int], text: str) -> tuple[int, int] | None:
    """Return the offsets of a span in the text, or None if it is outside of the text."""
    if not (0 < span.line <= span.end_line <= len(starts) and span.column > 0):
        return None
    start = starts[span.line - 1] + span.column - 1
    end = starts[span.end_line - 1] + span.end_column - 1
    return (start, end) if start <= end <= len(text) else None


def _unreadable(findings: Iterable[Diagnostic]) -> bool:
    return any(
        finding.severity is Severity.ERROR and _PARSE_ERROR_CODE.match(finding.code)
        for finding in findings
    )
