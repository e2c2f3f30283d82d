"""The report of PyYAML's scanner, and the text around the place where it failed."""

from __future__ import annotations

import msgspec

from r2bspec.diagnostics import Diagnostic, Edit, Related, Severity, Span
from r2bspec.language.source_text import Source


class ScannerReport(msgspec.Struct, frozen=True):
    """The scanner's report: where it failed, what it was reading, and the text there."""

    problem: str
    context: str
    problem_span: Span
    context_span: Span
    source: Source

    @property
    def line(self) -> str:
        """The line where the scanner failed."""
        return self.source.line(self.problem_span.line)

    @property
    def rest(self) -> str:
        """The text of the line from the failing column on."""
        return self.line[self.problem_span.column - 1 :]

    @property
    def before(self) -> str:
        """The text of the line before the failing column."""
        return self.line[: self.problem_span.column - 1]

    def error(
        self,
        code: str,
        message: str,
        help_text: str,
        *,
        span: Span | None = None,
        related: tuple[Related, ...] = (),
        edit: Edit | None = None,
    ) -> Diagnostic:
        """A diagnostic at the failing column, or at `span`."""
        return Diagnostic(
            code,
            Severity.ERROR,
            message,
            span or self.problem_span,
            help=help_text,
            related=related,
            edit=edit,
        )

    def rest_span(self) -> Span:
        """The span of the line's content from the failing column on."""
        start = self.problem_span.column
        end = start + max(len(self.rest.rstrip()), 1)
        return Span(
            self.problem_span.file, self.problem_span.line, start, self.problem_span.line, end
        )

    def line_span(self, number: int) -> Span:
        """The span of one line's content, without its indentation."""
        text = self.source.line(number)
        return Span(
            self.problem_span.file, number, indentation(text) + 1, number, len(text.rstrip()) + 1
        )

    def line_above(self) -> tuple[int, str]:
        """The nearest line above that has content: its number, and its text."""
        for number in range(self.problem_span.line - 1, 0, -1):
            text = self.source.line(number)
            if text.strip() and not text.lstrip().startswith("#"):
                return number, text
        return self.problem_span.line, ""


def indentation(line: str) -> int:
    """The number of spaces at the beginning of a line."""
    return len(line) - len(line.lstrip(" "))
