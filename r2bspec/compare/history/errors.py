"""What can be wrong with a history."""

from __future__ import annotations

from r2bspec.errors import R2bspecError
from r2bspec.exit_status import ExitStatus


class HistoryError(R2bspecError):
    """A history that cannot be read or written: damaged, of a newer version, or locked."""

    code = "R2B654"
    exit_code = ExitStatus.USAGE
