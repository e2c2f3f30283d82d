"""A document: its text, read and decoded, its diagnostics, and its state while it is loaded.

YAML also allows UTF-16 and UTF-32. They are refused here: no other tool of a ROS workspace reads
them, so a file in one of them is most likely an accident.

`Document` is one value that each step of loading changes. Values of extended files keep the place
where they are written; `ValueOrigins` are the places that led there.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path as FilePath
from typing import NoReturn, Unpack

import msgspec
from msgspec.structs import replace

from r2bspec.diagnostics import Diagnostic, Edit, Related, Severity, Span
from r2bspec.diagnostics.diagnostic import DiagnosticParts, split_lines
from r2bspec.language.located_tree import TreeNode
from r2bspec.safe_io import safe_file
from r2bspec.safe_io.file_search import path_hint
from r2bspec.safe_io.limits import MAX_DOCUMENT_BYTES

_FORBIDDEN_ASCII = re.compile("[^\t\n\r\x20-\x7e]")
"""Less than `_forbidden`, which takes longer to compile than a spec to parse."""
_UTF16_AND_UTF32_BOMS = (b"\xff\xfe", b"\xfe\xff", b"\x00\x00\xfe\xff")


@dataclass(frozen=True)
class Source:
    """The text of a document, the file name shown to the user, and problems of the text.

    With an error in `diagnostics`, the text serves for excerpts only.
    """

    file: str
    text: str
    diagnostics: tuple[Diagnostic, ...] = ()

    @cached_property
    def lines(self) -> list[str]:
        """The lines, split where YAML splits them, without line breaks."""
        return split_lines(self.text)

    def line(self, number: int) -> str:
        """Return the line with that number, counted from 1; empty if there is none."""
        return self.lines[number - 1] if 0 < number <= len(self.lines) else ""

    def span_at(self, offset: int) -> Span:
        """Return the span of the character at an offset into the text."""
        before = split_lines(self.text[:offset])
        line, column = len(before), len(before[-1]) + 1
        return Span(self.file, line, column, line, column + 1)


def has_errors(diagnostics: Iterable[Diagnostic]) -> bool:
    """Return True if any of some findings is an error."""
    return any(diagnostic.severity is Severity.ERROR for diagnostic in diagnostics)


def read_file(path: FilePath, folders: Iterable[FilePath] = ()) -> Source:
    """Read and decode a file; ``-`` is standard input. Problems become diagnostics.

    Args:
        path: the file. If it is a link, the file itself must be in `readable_folders` of the link.
        folders: further folders in which the file itself may be.
    """
    file = "<stdin>" if str(path) == "-" else str(path)
    try:
        if str(path) == "-":
            data = sys.stdin.buffer.read(MAX_DOCUMENT_BYTES + 1)
        else:
            allowed = readable_folders(path.parent, folders)
            data = safe_file.read_bytes(path, max_bytes=MAX_DOCUMENT_BYTES, folders=allowed)
    except safe_file.TooLargeError:
        return _too_large(file)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        message = f"cannot read the file: {reason}"
        return _unreadable(Source(file, ""), "R2B001", message, _reading_help(path, error))
    return decode(data, file)


def readable_folders(folder: FilePath, others: Iterable[FilePath]) -> Iterator[FilePath]:
    """Yield where files of a document may be: below its folder, or anywhere in its work tree."""
    yield folder
    yield from others
    from r2bspec.safe_io.git import find_work_tree

    if top := find_work_tree(folder):
        yield top


def _unreadable(
    source: Source, code: str, message: str, help_text: str, span: Span | None = None
) -> Source:
    problem = Diagnostic.error(code, message, span or Span.of_file(source.file), help_text)
    return Source(source.file, source.text, (problem,))


def _too_large(file: str) -> Source:
    message = f"the file is larger than {MAX_DOCUMENT_BYTES // 1_000_000} MB"
    help_text = "check the path: a spec refers to recorded data, it does not contain it"
    return _unreadable(Source(file, ""), "R2B002", message, help_text)


def _reading_help(path: FilePath, error: Exception) -> str:
    if isinstance(error, FileNotFoundError):
        return path_hint(path)
    if isinstance(error, safe_file.OutsideFolderError):
        return "copy the file here, or keep both in one work tree of git"
    hint = error.hint if isinstance(error, safe_file.RefusedFileError) else ""
    return hint or "name a regular file that you may read"


def decode(data: bytes, file: str) -> Source:
    """Decode the bytes of a document; `file` is its name in messages."""
    if len(data) > MAX_DOCUMENT_BYTES:
        return _too_large(file)
    help_text = "save it as UTF-8"
    if data.startswith(_UTF16_AND_UTF32_BOMS):
        message = "the file is encoded as UTF-16 or UTF-32, not as UTF-8"
        return _unreadable(Source(file, ""), "R2B003", message, help_text)
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        source = Source(file, data.decode("utf-8", errors="replace"))
        place = source.span_at(len(data[: error.start].decode("utf-8")))
        message = f"the file is not UTF-8: invalid byte 0x{data[error.start]:02x}"
        return _unreadable(source, "R2B003", message, help_text, place)
    return read_text(text, file)


def read_text(text: str, file: str) -> Source:
    """Check text that is already decoded."""
    if len(text) > MAX_DOCUMENT_BYTES:
        return _too_large(file)
    problems = DiagnosticCollector()
    if text.startswith("\ufeff"):
        text = text[1:]
        problems.diagnostics.append(
            Diagnostic(
                "R2B004",
                Severity.WARNING,
                "the file begins with a byte-order mark (BOM)",
                Span.of_file(file),
                help="save it as UTF-8 without BOM; some tools read it as part of the first key",
            )
        )
    source = Source(file, text)
    wrong = (_FORBIDDEN_ASCII if text.isascii() else _forbidden()).search(text)
    if wrong is not None:
        place = source.span_at(wrong.start())
        message = f"the character U+{ord(wrong[0]):04X} is not allowed in YAML"
        is_text = wrong[0] != "\0"
        help_text = "remove it" if is_text else "is this a text file?"
        edit = Edit(place, "") if is_text else None
        problems.error("R2B003", message, place, help_text, edit=edit)
    return Source(file, text, tuple(problems.diagnostics))


@cache
def _forbidden() -> re.Pattern[str]:
    """Return the characters outside of YAML's c-printable."""
    return re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def inner_span(source: Source | None, span: Span, text: str, offset: int, length: int) -> Span:
    """Return the span of ``text[offset : offset + length]``, where `text` is the value at `span`.

    Quotes, escapes and folded lines make the characters of the file differ from those of the value.
    Therefore the part is searched for in the file, as the occurrence of the same rank. If that
    fails, or if `source` is None, the result is the whole span.
    """
    if source is None:
        return span
    raw = _source_text(source, span)
    piece = text[offset : offset + length]
    if not piece:
        end = len(raw.rstrip())
        end -= 1 if raw[:1] in ("'", '"') and end > 1 else 0
        return _span_at_offset(span, raw, end, 1)
    rank = text.count(piece, 0, offset)
    found = -1
    for _ in range(rank + 1):
        found = raw.find(piece, found + 1)
        if found < 0:
            return span
    return _span_at_offset(span, raw, found, len(piece))


def _source_text(source: Source, span: Span) -> str:
    lines = source.lines[span.line - 1 : span.end_line]
    if not lines:
        return ""
    if span.line == span.end_line:
        return lines[0][span.column - 1 : span.end_column - 1]
    if len(lines) == span.end_line - span.line + 1:
        lines[-1] = lines[-1][: span.end_column - 1]
    lines[0] = lines[0][span.column - 1 :]
    return "\n".join(lines)


def _span_at_offset(span: Span, raw: str, start: int, length: int) -> Span:
    before = raw[:start]
    line = span.line + before.count("\n")
    column = start + span.column if line == span.line else start - before.rfind("\n")
    return Span(span.file, line, column, line, column + length)


MAX_PROBLEMS = 1000
"""Problems that one step reports at most; thousands are usually one mistake repeated."""


class StopReadingError(Exception):
    """The rest of the document is not read; the reason was reported."""


class DiagnosticCollector:
    """Collects the diagnostics of one step."""

    def __init__(self) -> None:
        self.diagnostics: list[Diagnostic] = []

    @property
    def full(self) -> bool:
        """Whether further errors would be dropped."""
        return len(self.diagnostics) >= MAX_PROBLEMS

    def error(
        self,
        code: str,
        message: str,
        span: Span,
        help_text: str = "",
        **parts: Unpack[DiagnosticParts],
    ) -> None:
        """Add an error, unless there are `MAX_PROBLEMS` already."""
        if not self.full:
            self.diagnostics.append(Diagnostic.error(code, message, span, help_text, **parts))

    def stop(self, code: str, message: str, span: Span, help_text: str = "") -> NoReturn:
        """Add an error and stop reading the document.

        Raises:
            StopReadingError: always.
        """
        self.diagnostics.append(Diagnostic.error(code, message, span, help_text))
        raise StopReadingError


class ValueOrigins(msgspec.Struct, frozen=True):
    """For each extended file, the places that led to it, the nearest first."""

    files: dict[str, tuple[Related, ...]] = msgspec.field(default_factory=dict)

    def with_origins(self, diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
        """Return the diagnostics, each with the places that led to its file."""
        if not self.files:
            return list(diagnostics)
        located = []
        for problem in diagnostics:
            origins = self.files.get(problem.span.file, ())
            new = tuple(origin for origin in origins if origin not in problem.related)
            located.append(replace(problem, related=(*problem.related, *new)) if new else problem)
        return located


class Document(msgspec.Struct):
    """What all cases of a document share.

    Attributes:
        tree: None where the text is not YAML.
        sources: the texts that places point into, by file name.
        is_incomplete: whether a file that it extends could not be read.
    """

    file: str
    tree: TreeNode | None = None
    problems: DiagnosticCollector = msgspec.field(default_factory=DiagnosticCollector)
    sources: dict[str, Source] = msgspec.field(default_factory=dict)
    origins: ValueOrigins = msgspec.field(default_factory=ValueOrigins)
    is_incomplete: bool = False

    @property
    def base_dir(self) -> FilePath:
        """The folder to which paths in the document are relative."""
        return FilePath(self.file).parent
