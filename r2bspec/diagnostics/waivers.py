"""Waivers: ``# r2bspec: ignore[CODE] reason``, on the line of a finding or just above it.

A waiver says to readers why something that looks wrong is meant. Without a reason it says nothing
and waives nothing. Errors that keep the document from being read cannot be waived: there would be
nothing to run. Several codes stand in one pair of brackets, separated by commas.
"""

from __future__ import annotations

import contextlib
import re
from bisect import bisect_right
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from r2bspec.diagnostics.diagnostic import Diagnostic, Severity, Span
from r2bspec.diagnostics.quote import quote
from r2bspec.diagnostics.source_lines import split_lines
from r2bspec.diagnostics.suggest import did_you_mean

WAIVER_WITHOUT_REASON = "R2B040"
UNKNOWN_CODE = "R2B041"
UNUSED_WAIVER = "R2B042"
NOT_WAIVABLE = "R2B043"

MAX_FINDINGS = 1000
"""Findings beyond which none about waivers are added: more help nobody."""

_WAIVER_SYNTAX = "# r2bspec: ignore[CODE] reason"
_COMMENT = re.compile(r"(?<![^\s\ufeff])#[ \t]*r2bspec[ \t]*:[ \t]*ignore\b")
_CODES_AND_REASON = re.compile(r"\s*\[([^\]]*)\]:?\s*(.*)")
_MACHINE_DEPENDENT = re.compile(r"R2B(?:202|[36]\d\d)$")
"""Findings that depend on the machine or its data: a waiver without one here may have one there."""
_UNREADABLE_CODE = re.compile(r"R2B[01]\d\d$")


@dataclass(frozen=True, slots=True)
class Waiver:
    """One code that one comment waives.

    Attributes:
        code: as written, in capitals; empty where the comment names none.
        reason: why; empty where the comment does not say.
        span: the code, or the whole comment where it names none.
        line: the line whose findings are meant.
    """

    code: str
    reason: str
    span: Span
    line: int


def apply_waivers(
    found: Iterable[Diagnostic],
    texts: Mapping[str, str],
    *,
    known: Callable[[], Collection[str]],
    complete: bool,
) -> list[Diagnostic]:
    """What is left of the findings, and what is wrong with the waivers themselves.

    Args:
        found: everything that was found.
        texts: the texts that the findings point into, by file name.
        known: gives every code there is; called only where there are waivers.
        complete: whether everything has been looked at, so that a waiver without a finding
            is a waiver too many.
    """
    found = list(found)
    waivers = [one for file, text in texts.items() for one in waivers_in(text, file)]
    if not waivers:
        return found
    usable = {(one.span.file, one.line, one.code): one for one in waivers if one.reason}
    used: set[tuple[str, int, str]] = set()
    left: list[Diagnostic] = []
    for one in found:
        key = (one.span.file, one.span.line, one.code)
        if key not in usable:
            left.append(one)
            continue
        used.add(key)
        if _is_waivable(one):
            continue
        left += [one, _not_waivable(usable[key])]
    codes = known()
    for waiver in waivers:
        if len(left) >= MAX_FINDINGS:
            break
        key = (waiver.span.file, waiver.line, waiver.code)
        left += _check_waiver(waiver, codes, unused=complete and key not in used)
    return left


def may_contain_waiver(text: str) -> bool:
    """Whether a text may hold a waiver; quick, and wrong where a value looks like a comment."""
    return _COMMENT.search(text) is not None


def waivers_in(text: str, file: str) -> Iterator[Waiver]:
    """Every waiver in the comments of a text."""
    if not may_contain_waiver(text):
        return
    lines = split_lines(text)
    hidden = _value_spans(text)
    below = _target_lines(lines)
    for number, line in enumerate(lines, start=1):
        comment = _COMMENT.search(line)
        if comment is None or (number, comment.start() + 1) in hidden:
            continue
        start, end = comment.start() + 1, len(line.rstrip()) + 1
        whole = Span(file, number, start, number, end)
        target_line = number if line[: comment.start()].strip() else below[number]
        yield from _waivers(line, comment.end(), whole, target_line)


def _waivers(line: str, offset: int, whole: Span, target_line: int) -> Iterator[Waiver]:
    match = _CODES_AND_REASON.match(line, offset)
    if match is None or not match[1].strip():
        yield Waiver("", "", whole, target_line)
        return
    for word in re.finditer(r"[^,\s]+", match[1]):
        column = match.start(1) + word.start() + 1
        span = Span(whole.file, whole.line, column, whole.line, column + len(word[0]))
        yield Waiver(word[0].upper(), match[2].strip(), span, target_line)


def _target_lines(lines: list[str]) -> list[int]:
    """For the line of each number the line of which its comment speaks.

    That is the first line below that holds more than a comment, or the last line of all.
    """
    below = [0] * (len(lines) + 1)
    following = len(lines)
    for number in range(len(lines), 0, -1):
        below[number] = following
        if not lines[number - 1].lstrip().startswith("#"):
            following = number
    return below


class _SpanSet:
    """A set of places in a text, given by the beginnings and ends of its stretches, in order."""

    def __init__(self) -> None:
        self._starts: list[tuple[int, int]] = []
        self._ends: list[tuple[int, int]] = []

    def add(self, start: Any, end: Any) -> None:
        """Add the stretch between two marks of the parser."""
        self._starts.append((start.line + 1, start.column + 1))
        self._ends.append((end.line + 1, end.column + 1))

    def __contains__(self, place: tuple[int, int]) -> bool:
        before = bisect_right(self._starts, place)
        return before > 0 and place < self._ends[before - 1]


def _value_spans(text: str) -> _SpanSet:
    """Places that are part of a value, such as a line of a block of text with a '#' in it."""
    import yaml

    loader: Any = getattr(yaml, "CLoader", yaml.Loader)
    places = _SpanSet()
    # What cannot be scanned is reported where the document is read.
    with contextlib.suppress(yaml.YAMLError):
        for token in yaml.scan(text, Loader=loader):
            if isinstance(token, yaml.ScalarToken) and not token.plain:
                places.add(token.start_mark, token.end_mark)
    return places


def _is_waivable(found: Diagnostic) -> bool:
    return found.severity is not Severity.ERROR or not _UNREADABLE_CODE.match(found.code)


def _check_waiver(waiver: Waiver, known: Collection[str], *, unused: bool) -> Iterator[Diagnostic]:
    if not waiver.code:
        yield _warning(
            WAIVER_WITHOUT_REASON,
            "this waiver does not say which code it means",
            waiver,
            f"write '{_WAIVER_SYNTAX}'",
        )
    elif waiver.code not in known:
        close = did_you_mean(waiver.code, known)
        yield _warning(
            UNKNOWN_CODE,
            f"there is no code {quote(waiver.code)} to waive",
            waiver,
            f"did you mean {close}? " * bool(close) + "'r2bspec explain' lists all codes",
        )
    elif not waiver.reason:
        yield _warning(
            WAIVER_WITHOUT_REASON,
            f"the waiver of {waiver.code} gives no reason, so it waives nothing",
            waiver,
            f"say why behind the brackets: '{_WAIVER_SYNTAX}'",
        )
    elif unused and not _MACHINE_DEPENDENT.match(waiver.code):
        yield _warning(
            UNUSED_WAIVER,
            f"nothing is left for this waiver of {waiver.code} to waive",
            waiver,
            "remove it",
        )


def _not_waivable(waiver: Waiver) -> Diagnostic:
    return _warning(
        NOT_WAIVABLE,
        f"{waiver.code} cannot be waived: the document could not be used",
        waiver,
        "put right what it reports, and remove the waiver",
    )


def _warning(code: str, message: str, waiver: Waiver, help_text: str) -> Diagnostic:
    return Diagnostic(code, Severity.WARNING, message, waiver.span, help=help_text)
