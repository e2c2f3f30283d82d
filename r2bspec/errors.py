"""The common base of all errors that are shown to a user, as a line and a hint."""

from __future__ import annotations

from r2bspec.exit_status import ExitStatus


class R2bspecError(Exception):
    """A problem that the user can act on.

    Every package derives its own errors from this class. The command line prints `code`, the
    message and `hint`, and exits with `exit_code`; a traceback is never shown for it.

    Attributes:
        code: the diagnostic code, such as ``R2B301``; see ``r2bspec explain``.
        hint: what to do about it, in one sentence; may be empty.
        exit_code: the exit status for this error.
        remainder: what is left to print where the findings of this error have been printed at
            their places; None if nothing was printed.
    """

    code: str = "R2B600"
    exit_code: ExitStatus = ExitStatus.RUN_FAILED
    remainder: str | None = None

    def __init__(self, message: str, *, hint: str = "", code: str | None = None) -> None:
        super().__init__(message)
        self.hint = hint
        if code is not None:
            self.code = code


def without_output(message: str) -> str:
    """The first line of a message, without the output of a process that may follow it."""
    return message.partition("\n")[0].removesuffix("; its last output:")


class UsageError(R2bspecError):
    """Wrong usage, or an input that the command cannot use."""

    code = "R2B601"
    exit_code = ExitStatus.USAGE
