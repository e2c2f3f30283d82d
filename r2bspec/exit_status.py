"""The exit statuses of the program and of its child processes: every one, and what it means."""

from __future__ import annotations

from enum import IntEnum


class ExitStatus(IntEnum):
    """How a process of r2bspec ends; a number that says it to a shell or a pipeline.

    Attributes:
        meaning: one clause, as ``--help`` and the documentation show it.
    """

    meaning: str

    def __new__(cls, value: int, meaning: str) -> ExitStatus:
        """A status that is its number, and knows its meaning."""
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
    """Every status with its meaning, in one sentence."""
    return "; ".join(f"{status.value} {status.meaning}" for status in ExitStatus)
