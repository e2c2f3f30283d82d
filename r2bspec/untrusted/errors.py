"""What is refused before its content is used."""

from __future__ import annotations

from r2bspec.errors import R2bspecError
from r2bspec.exit_status import ExitStatus


class RefusedFileError(R2bspecError, OSError):
    """A file that is not opened, or not read to its end.

    Callers report it like any other file that cannot be read, under a code of their own. The
    message never quotes the content of the file.
    """

    code = "R2B001"
    exit_code = ExitStatus.USAGE

    def __init__(self, reason: str, *, hint: str = "") -> None:
        super().__init__(reason, hint=hint)
        self.strerror = reason


class OutsideFolderError(RefusedFileError):
    """A link that leads out of the folders whose files may be read."""


class TooLargeError(RefusedFileError):
    """A file that is larger than the limit of its kind."""


class RefusedDataError(R2bspecError, ValueError):
    """Data that would need too much memory or time to decode."""

    code = "R2B304"
    exit_code = ExitStatus.USAGE
