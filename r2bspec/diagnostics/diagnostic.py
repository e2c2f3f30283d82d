"""The types of diagnostics, and the lines to which their spans refer."""

from __future__ import annotations

import re
from enum import StrEnum
from typing import TypedDict, Unpack

import msgspec

Path = tuple[str | int, ...]
"""The place of a value in the document: keys and list indices from the root."""


MAX_MESSAGE_CHARACTERS = 2_000
"""Of a message or help; those of r2bspec itself stay far below, and the rest is of a file."""

LINE_BREAK = re.compile(r"\r\n|[\n\r\x85\u2028\u2029]")
"""Lines end where they end for YAML."""


class Severity(StrEnum):
    """The severity of a problem. Only an error prevents a run."""

    ERROR = "error"
    WARNING = "warning"
    INFO = "info"


class Certainty(StrEnum):
    """Whether a finding is true everywhere or depends on this machine."""

    CERTAIN = "certain"
    ENVIRONMENT = "environment"


class Span(msgspec.Struct, frozen=True, gc=False):
    """A part of a file. Lines and columns count from 1, in characters; the end is exclusive."""

    file: str
    line: int
    column: int
    end_line: int
    end_column: int

    @classmethod
    def of_file(cls, file: str) -> Span:
        """Return the beginning of a file, for problems without a more specific place."""
        return cls(file, 1, 1, 1, 1)


def split_lines(text: str) -> list[str]:
    """Return the lines of a text as YAML splits them, without line breaks."""
    return LINE_BREAK.split(text)


class Related(msgspec.Struct, frozen=True, gc=False):
    """Another place related to a problem."""

    message: str
    span: Span


class Edit(msgspec.Struct, frozen=True, gc=False):
    """A replacement that is safe to apply automatically."""

    span: Span
    text: str


class DiagnosticParts(TypedDict, total=False):
    """The optional parts of a diagnostic, besides its message, place and help."""

    path: Path
    related: tuple[Related, ...]
    edit: Edit | None
    certainty: Certainty


class Diagnostic(msgspec.Struct, frozen=True, gc=False):
    """A problem: its code, severity, message, place, and how to fix it.

    Attributes:
        code: such as ``R2B204``.
        message: one sentence without a full stop.
        path: the place of the value in the document.
        help: how to fix the problem; empty if the message says it.
        related: other places that explain the problem.
    """

    code: str
    severity: Severity
    message: str
    span: Span
    path: Path = ()
    help: str = ""
    related: tuple[Related, ...] = ()
    edit: Edit | None = None
    certainty: Certainty = Certainty.CERTAIN

    def __post_init__(self) -> None:
        """Clip texts that a file could make endless, once for all formats."""
        for name in ("message", "help"):
            if len(getattr(self, name)) > MAX_MESSAGE_CHARACTERS:
                text = getattr(self, name)[: MAX_MESSAGE_CHARACTERS - 1]
                msgspec.structs.force_setattr(self, name, f"{text}…")

    @classmethod
    def error(
        cls,
        code: str,
        message: str,
        span: Span,
        help_text: str = "",
        **parts: Unpack[DiagnosticParts],
    ) -> Diagnostic:
        """Return an error."""
        return cls(code, Severity.ERROR, message, span, help=help_text, **parts)

    @property
    def sort_key(self) -> tuple[str, int, int, str, str]:
        """The key that orders by place, then by code."""
        return (self.span.file, self.span.line, self.span.column, self.code, self.message)


def format_path(path: Path) -> str:
    """Return a path as text: ``graph.nodes.resize.remappings``, ``rates[0]``."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        elif part.replace("_", "").replace("-", "").isalnum():
            text += f".{part}" if text else part
        else:
            text += f"['{part}']"
    return text
