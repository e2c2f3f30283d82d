"""The one hierarchy of errors that reach a user as a line and a hint."""

from __future__ import annotations

from r2bspec.exit_status import ExitStatus


class R2bspecError(Exception):
    """A problem that the user can act on.

    Every package derives its own errors from this class. The command line prints `code`, the
    message and `hint`, and exits with `exit_code`; a traceback is never shown for it.

    Attributes:
        code: the diagnostic code, such as ``R2B301``; ``r2bspec explain`` knows each.
        hint: what to do about it, in one sentence; empty where the message says it all.
        exit_code: the exit status that this error leads to.
    """

    code: str = "R2B600"
    exit_code: ExitStatus = ExitStatus.RUN_FAILED

    def __init__(self, message: str, *, hint: str = "", code: str | None = None) -> None:
        super().__init__(message)
        self.hint = hint
        if code is not None:
            self.code = code


class UsageError(R2bspecError):
    """Wrong usage, or an input that the verb cannot use."""

    code = "R2B601"
    exit_code = ExitStatus.USAGE
