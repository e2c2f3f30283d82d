"""What can be wrong with results that are to be read or compared."""

from __future__ import annotations

from typing import Final

from r2bspec.errors import R2bspecError
from r2bspec.exit_status import ExitStatus

SAMPLES_MISSING: Final = "R2B661"
RESULT_UNREADABLE: Final = "R2B662"
RUNS_INCOMPARABLE: Final = "R2B663"


class SamplesMissingError(R2bspecError):
    """Only the result of a run is known, and what was asked for needs its samples."""

    code = SAMPLES_MISSING
    exit_code = ExitStatus.USAGE


class UnreadableResultError(R2bspecError):
    """A file that was to be read as a result or as a report is neither."""

    code = RESULT_UNREADABLE
    exit_code = ExitStatus.USAGE


class IncomparableError(R2bspecError):
    """Results that differ in more than their numbers."""

    code = RUNS_INCOMPARABLE
    exit_code = ExitStatus.USAGE
