"""Errors in the requested reports."""

from __future__ import annotations

from typing import Final

from r2bspec.errors import ExitStatus, R2bspecError, UsageError

REPORT_FORMAT_UNKNOWN: Final = "R2B660"
REPORT_UNMAKEABLE: Final = "R2B661"


class ReportUsageError(UsageError):
    """An invalid request for a report: an unknown format, or two reports to one stream."""

    code = REPORT_FORMAT_UNKNOWN


class ReportError(R2bspecError):
    """A report cannot be written: a library is missing, or the run has no samples for it."""

    code = REPORT_UNMAKEABLE
    exit_code = ExitStatus.USAGE
