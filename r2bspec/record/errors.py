"""Errors of run folders."""

from __future__ import annotations

from typing import Final

from r2bspec.errors import R2bspecError
from r2bspec.exit_status import ExitStatus

RUN_UNREADABLE: Final = "R2B650"
RUN_UNWRITABLE: Final = "R2B651"


class RecordError(R2bspecError):
    """A run folder cannot be written or read.

    The message names the file; `hint` is the remedy.
    """

    code = RUN_UNREADABLE
    exit_code = ExitStatus.USAGE


class FolderTakenError(RecordError):
    """The folder of a run is not empty, or belongs to another run: nothing in it is this run's."""

    code = RUN_UNWRITABLE
