"""A growing list of diagnostics, with a limit, and a way to stop reading the document."""

from __future__ import annotations

from typing import NoReturn

from r2bspec.diagnostics import Certainty, Diagnostic, Edit, Related, Severity, Span

MAX_PROBLEMS = 1000
"""Problems that one step reports at most; thousands are usually one mistake repeated."""


class StopReadingError(Exception):
    """The rest of the document is not read; the reason has been reported."""


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
        *,
        related: tuple[Related, ...] = (),
        edit: Edit | None = None,
        certainty: Certainty = Certainty.CERTAIN,
    ) -> None:
        """Add an error, unless there are `MAX_PROBLEMS` already."""
        if self.full:
            return
        self.diagnostics.append(
            Diagnostic(
                code,
                Severity.ERROR,
                message,
                span,
                help=help_text,
                related=related,
                edit=edit,
                certainty=certainty,
            )
        )

    def stop(self, code: str, message: str, span: Span, help_text: str = "") -> NoReturn:
        """Add an error and stop reading the document.

        Raises:
            StopReadingError: always.
        """
        self.diagnostics.append(Diagnostic(code, Severity.ERROR, message, span, help=help_text))
        raise StopReadingError
