"""What can be wrong with a report that was asked for, and with runs that are to be compared."""

from __future__ import annotations

from typing import Final

from r2bspec.errors import R2bspecError, UsageError

REPORT_FORMAT_UNKNOWN: Final = "R2B660"
REPORT_UNMAKEABLE: Final = "R2B661"
REPORT_UNREADABLE: Final = "R2B662"
RUNS_INCOMPARABLE: Final = "R2B663"


class ReportUsageError(UsageError):
    """A report was asked for in a way that cannot be: no such format, or two on one stream."""

    code = REPORT_FORMAT_UNKNOWN


class ReportError(R2bspecError):
    """A report cannot be made: a library is missing, or the run holds no samples for it."""

    code = REPORT_UNMAKEABLE
    exit_code = 2


class UnreadableResultError(R2bspecError):
    """A file that was to be read as a result or as a report is neither."""

    code = REPORT_UNREADABLE
    exit_code = 2


class IncomparableError(R2bspecError):
    """Results that differ in more than their numbers."""

    code = RUNS_INCOMPARABLE
    exit_code = 2
