"""Waivers: ``# r2bspec: ignore[CODE] reason``, on the line of a finding or on the line above it.

A waiver tells readers why something that looks wrong is intended. A waiver without a reason has no
effect. Errors that make the document unreadable cannot be waived: there would be nothing to run.
A code is written as a number (``R2B323``) or as its slug (``unknown-key``); several are separated
by commas.
"""

from __future__ import annotations

import contextlib
import re
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import msgspec
from msgspec.structs import replace

from r2bspec.diagnostics.diagnostic import Diagnostic, Severity, Span, split_lines
from r2bspec.diagnostics.quote import did_you_mean, quote

WAIVER_WITHOUT_REASON = "R2B040"
UNKNOWN_CODE = "R2B041"
UNUSED_WAIVER = "R2B042"
NOT_WAIVABLE = "R2B043"

_WAIVER_SYNTAX = "# r2bspec: ignore[CODE] reason"
# What is before the ``#`` is looked at after it was found: a search for one character is fast.
_COMMENT = re.compile(r"#(?<![^\s\ufeff]#)[ \t]*r2bspec[ \t]*:[ \t]*ignore\b")
_CODES_AND_REASON = re.compile(r"\s*\[([^\]]*)\]:?\s*(.*)")
_MACHINE_DEPENDENT = re.compile(r"R2B(?:202|[36]\d\d)$")
"""Findings that depend on the machine or its data: a waiver unused here may be used elsewhere."""
_UNREADABLE_CODE = re.compile(r"R2B[01]\d\d$")


class Waiver(msgspec.Struct, frozen=True):
    """A code that a comment waives.

    Attributes:
        written: the code or the slug as written; empty where the comment names none.
        reason: why; empty where the comment gives none.
        span: the code, or the whole comment where it names none.
        line: the line whose findings are waived.
        code: the code that is meant; empty until it is looked up, and for an unknown one.
    """

    written: str
    reason: str
    span: Span
    line: int
    code: str = ""


def apply_waivers(
    found: Iterable[Diagnostic],
    texts: Mapping[str, str],
    *,
    known: Callable[[], Mapping[str, str]],
    complete: bool,
) -> list[Diagnostic]:
    """Return the findings that are not waived, and findings about the waivers themselves.

    Args:
        found: all findings.
        texts: the texts that the findings point into, by file name.
        known: gives the slug of every code; called only where there are waivers.
        complete: whether everything was checked, so that a waiver without a finding is unused.
    """
    found = list(found)
    waivers = [waiver for file, text in texts.items() for waiver in waivers_in(text, file)]
    if not waivers:
        return found
    slugs = known()
    waivers = [_with_code(usable_waiver, slugs) for usable_waiver in waivers]
    usable = {
        (usable_waiver.span.file, usable_waiver.line, usable_waiver.code): usable_waiver
        for usable_waiver in waivers
        if usable_waiver.reason
    }
    used: set[tuple[str, int, str]] = set()
    left: list[Diagnostic] = []
    for finding in found:
        key = (finding.span.file, finding.span.line, finding.code)
        if key not in usable:
            left.append(finding)
            continue
        used.add(key)
        if finding.severity is Severity.ERROR and _UNREADABLE_CODE.match(finding.code):
            waiver = usable[key]
            message = f"{waiver.written} cannot be waived: it leaves no spec that could run"
            help_text = "fix the error and remove the waiver"
            left += [finding, _warning(NOT_WAIVABLE, message, waiver, help_text)]
    for waiver in waivers:
        key = (waiver.span.file, waiver.line, waiver.code)
        left += _check_waiver(waiver, slugs, unused=complete and key not in used)
    return left


def effective_waivers(texts: Mapping[str, str], slugs: Mapping[str, str]) -> Iterator[Waiver]:
    """Yield the waivers in some texts that give a reason and name a code that exists.

    Args:
        texts: by file name.
        slugs: the slug of every code.
    """
    for file, text in texts.items():
        for waiver in waivers_in(text, file):
            resolved = _with_code(waiver, slugs)
            if resolved.code and resolved.reason:
                yield resolved


def may_contain_waiver(text: str) -> bool:
    """Return True if a text may contain a waiver, by a fast search.

    A value that looks like a comment counts, too.
    """
    return _COMMENT.search(text) is not None


def waivers_in(text: str, file: str) -> Iterator[Waiver]:
    """Yield every waiver in the comments of a text."""
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
        yield Waiver(word[0], match[2].strip(), span, target_line)


def _target_lines(lines: list[str]) -> list[int]:
    """Return for each line number the line to which a comment there applies.

    That is the first line below that has more than a comment, or the last line of the text.
    """
    below = [0] * (len(lines) + 1)
    following = len(lines)
    for number in range(len(lines), 0, -1):
        below[number] = following
        if not lines[number - 1].lstrip().startswith("#"):
            following = number
    return below


class _SpanSet:
    """A set of places in a text, given by the starts and ends of its spans, in order."""

    def __init__(self) -> None:
        self._starts: list[tuple[int, int]] = []
        self._ends: list[tuple[int, int]] = []

    def add(self, start: Any, end: Any) -> None:
        """Add the span between two marks of the parser."""
        self._starts.append((start.line + 1, start.column + 1))
        self._ends.append((end.line + 1, end.column + 1))

    def __contains__(self, place: tuple[int, int]) -> bool:
        before = bisect_right(self._starts, place)
        return before > 0 and place < self._ends[before - 1]


def _value_spans(text: str) -> _SpanSet:
    """Places that are part of a value, such as a line of a block scalar with a '#' in it."""
    import yaml

    loader: Any = getattr(yaml, "CLoader", yaml.Loader)
    places = _SpanSet()
    # Syntax errors are reported where the document is read.
    with contextlib.suppress(yaml.YAMLError):
        for token in yaml.scan(text, Loader=loader):
            if isinstance(token, yaml.ScalarToken) and not token.plain:
                places.add(token.start_mark, token.end_mark)
    return places


def _with_code(waiver: Waiver, slugs: Mapping[str, str]) -> Waiver:
    """Return the waiver with the code that it names by number or by slug."""
    code = waiver.written.upper()
    if code in slugs:
        return replace(waiver, code=code)
    slug = waiver.written.lower()
    return replace(waiver, code=next((code for code in slugs if slugs[code] == slug), ""))


def _check_waiver(
    waiver: Waiver, slugs: Mapping[str, str], *, unused: bool
) -> Iterator[Diagnostic]:
    if not waiver.written:
        message = "this waiver names no code"
        yield _warning(WAIVER_WITHOUT_REASON, message, waiver, f"write '{_WAIVER_SYNTAX}'")
    elif not waiver.code:
        close = did_you_mean(waiver.written, (*slugs, *slugs.values()))
        message = f"unknown code {quote(waiver.written)}: this waiver has no effect"
        help_text = f"did you mean {close}? " * bool(close) + "'r2bspec docs codes' lists all codes"
        yield _warning(UNKNOWN_CODE, message, waiver, help_text)
    elif not waiver.reason:
        message = f"the waiver of {waiver.written} has no effect: it gives no reason"
        help_text = f"add the reason after the brackets: '{_WAIVER_SYNTAX}'"
        yield _warning(WAIVER_WITHOUT_REASON, message, waiver, help_text)
    elif unused and not _MACHINE_DEPENDENT.match(waiver.code):
        message = f"unused waiver: its line has no finding {waiver.written}"
        yield _warning(UNUSED_WAIVER, message, waiver, "remove it")


def _warning(code: str, message: str, waiver: Waiver, help_text: str) -> Diagnostic:
    return Diagnostic(code, Severity.WARNING, message, waiver.span, help=help_text)
