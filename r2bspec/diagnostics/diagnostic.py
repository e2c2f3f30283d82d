"""The values of which every report of problems is made."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

Path = tuple[str | int, ...]
"""Where a value stands in the document: keys and list indices from the root."""


class Severity(StrEnum):
    """How bad a problem is. Only an error stops a run."""

    ERROR = "error"
    WARNING = "warning"
    INFO = "info"


class Certainty(StrEnum):
    """Whether a finding holds everywhere or depends on the machine at hand."""

    CERTAIN = "certain"
    ENVIRONMENT = "environment"


@dataclass(frozen=True, slots=True)
class Span:
    """A piece of a file. Lines and columns count from 1, in characters; `end_column` is past it."""

    file: str
    line: int
    column: int
    end_line: int
    end_column: int

    @classmethod
    def of_file(cls, file: str) -> Span:
        """The beginning of a file, for problems that have no better place."""
        return cls(file, 1, 1, 1, 1)


@dataclass(frozen=True, slots=True)
class Related:
    """Another place that explains a problem."""

    message: str
    span: Span


@dataclass(frozen=True, slots=True)
class Edit:
    """A replacement that is safe to apply by machine."""

    span: Span
    text: str


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One problem, complete: what, how bad, where, and the way out.

    Attributes:
        code: the rule's code, such as ``R2B204``.
        message: one sentence without a full stop.
        path: where the value stands in the document.
        help: the way out, in words; empty if the message says it.
    """

    code: str
    severity: Severity
    message: str
    span: Span
    path: Path = ()
    help: str = ""
    related: tuple[Related, ...] = ()
    edit: Edit | None = None
    certainty: Certainty = field(default=Certainty.CERTAIN)

    @property
    def sort_key(self) -> tuple[str, int, int, str, str]:
        """Orders by place, then code, so that a report reads like the file."""
        return (self.span.file, self.span.line, self.span.column, self.code, self.message)


def format_path(path: Path) -> str:
    """Write a path the way a user addresses it: ``graph.nodes.resize.remappings``, ``rates[0]``."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        elif part.replace("_", "").replace("-", "").isalnum():
            text += f".{part}" if text else part
        else:
            text += f"['{part}']"
    return text
