"""Errors in results that are to be read or compared."""

from __future__ import annotations

from typing import Final

from r2bspec.errors import ExitStatus, R2bspecError

SAMPLES_MISSING: Final = "R2B661"
RESULT_UNREADABLE: Final = "R2B662"
RUNS_INCOMPARABLE: Final = "R2B663"


class SamplesMissingError(R2bspecError):
    """Only the result of a run is known, and its samples are needed."""

    code = SAMPLES_MISSING
    exit_code = ExitStatus.USAGE


class UnreadableResultError(R2bspecError):
    """A file is neither a result nor a report."""

    code = RESULT_UNREADABLE
    exit_code = ExitStatus.USAGE

    def __init__(
        self,
        message: str,
        *,
        hint: str = "Name a run folder, a result.json, or a report of ros2_benchmark.",
    ) -> None:
        super().__init__(message, hint=hint)


class IncomparableError(R2bspecError):
    """Results that differ in more than their numbers."""

    code = RUNS_INCOMPARABLE
    exit_code = ExitStatus.USAGE
