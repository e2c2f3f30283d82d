"""How r2bspec ends, and the common base of all errors that are shown to a user."""

from __future__ import annotations

import errno
from enum import IntEnum
from typing import ClassVar, Final


class ExitStatus(IntEnum):
    """How a process of r2bspec ends, as the number that a shell or a pipeline reads.

    Attributes:
        meaning: one clause, as ``--help`` and the documentation show it.
    """

    meaning: str

    def __new__(cls, value: int, meaning: str) -> ExitStatus:
        """Return a status that is its number, and has its meaning as text."""
        status = int.__new__(cls, value)
        status._value_ = value
        status.meaning = meaning
        return status

    OK = 0, "no errors, or every requirement is met"
    FINDINGS_OR_FAILED = 1, "errors were found, or a requirement failed"
    USAGE = 2, "wrong usage, or an input or installation that cannot be used"
    INCONCLUSIVE = 3, "inconclusive"
    RUN_FAILED = 4, "the run itself failed or is invalid, safe to retry"
    INTERNAL_ERROR = 70, "r2bspec itself failed, with a traceback in a file: please report it"
    INTERRUPTED = 130, "interrupted"
    OUTPUT_CLOSED = 141, "the program that read the output has ended"


def exit_status_text() -> str:
    """Return every status with its meaning, in one sentence."""
    return "; ".join(f"{status.value} {status.meaning}" for status in ExitStatus)


class R2bspecError(Exception):
    """A problem that the user can act on.

    Every package derives its own errors from this class. The command line prints `code`, the
    message and `hint`, and exits with `exit_code`; a traceback is never shown for it.

    Attributes:
        code: the diagnostic code, such as ``R2B301``; see ``r2bspec docs``.
        way_out: the hint of every error of a class that has none of its own.
        hint: what to do about it, in one sentence.
        exit_code: the exit status for this error.
        remainder: what is left to print where the findings of this error have been printed at
            their places; None if nothing was printed.
    """

    code: str = "R2B600"
    exit_code: ExitStatus = ExitStatus.RUN_FAILED
    way_out: ClassVar[str] = ""
    remainder: str | None = None

    def __init__(self, message: str, *, hint: str = "", code: str | None = None) -> None:
        super().__init__(message)
        self.hint = hint or self.way_out
        if code is not None:
            self.code = code


OUTPUT_FOLLOWS: Final = "; its last output:\n"
"""Between what is said of a process, and the last lines that it wrote."""


def split_output(message: str) -> tuple[str, str]:
    """Return the message on a process, and the last lines of its output, if any follow."""
    text, _, output = message.partition(OUTPUT_FOLLOWS)
    return text, output


def without_output(message: str) -> str:
    """Return the first line of a message, without the output of a process that may follow it."""
    return split_output(message)[0].partition("\n")[0]


class UsageError(R2bspecError):
    """Wrong usage, or an input that the command cannot use."""

    code = "R2B601"
    exit_code = ExitStatus.USAGE


_REFUSALS = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS})


def is_refusal(error: OSError) -> bool:
    """Return True if an error says that the disk, or a limit of the user, has no room."""
    return error.errno in _REFUSALS


def refusal_hint(error: OSError) -> str:
    """Return the remedy of a full disk or a limit."""
    if error.errno == errno.EFBIG:
        return "Raise the limit on the size of a file: ulimit -f unlimited."
    if error.errno in {errno.EMFILE, errno.ENFILE}:
        return "Raise the limit on open files: ulimit -n 4096."
    if error.errno in {errno.EACCES, errno.EPERM}:
        return "Choose a folder that you may write with --output."
    return "Free space on this disk, or choose another folder with --output."


def refusal_text(error: OSError) -> str:
    """Return the error with its file, if that is known."""
    what = error.filename or "a file of the run"
    return f"{what} cannot be written: {error.strerror or error}"
