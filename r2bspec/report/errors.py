"""What can be wrong with a report that was asked for."""

from __future__ import annotations

from typing import Final

from r2bspec.errors import R2bspecError, UsageError
from r2bspec.exit_status import ExitStatus

REPORT_FORMAT_UNKNOWN: Final = "R2B660"
REPORT_UNMAKEABLE: Final = "R2B661"


class ReportUsageError(UsageError):
    """A report was asked for in a way that cannot be: no such format, or two on one stream."""

    code = REPORT_FORMAT_UNKNOWN


class ReportError(R2bspecError):
    """A report cannot be made: a library is missing, or the run holds no samples for it."""

    code = REPORT_UNMAKEABLE
    exit_code = ExitStatus.USAGE
