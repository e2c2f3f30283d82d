"""Errors of recorded data, with hints."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from r2bspec.diagnostics.quote import printable
from r2bspec.errors import R2bspecError
from r2bspec.exit_status import ExitStatus

BAG_NOT_FOUND: Final = "R2B301"
METADATA_UNREADABLE: Final = "R2B302"
STORAGE_MISSING: Final = "R2B303"
STORAGE_UNREADABLE: Final = "R2B304"
LFS_POINTER: Final = "R2B305"
SERIALIZATION_UNSUPPORTED: Final = "R2B306"
DATASET_UNKNOWN: Final = "R2B307"
TOPIC_NOT_IN_BAG: Final = "R2B308"
WINDOW_OUTSIDE_BAG: Final = "R2B309"
METADATA_DISAGREES: Final = "R2B310"
DATASET_NOT_WRITTEN: Final = "R2B311"
RECORDING_NOT_CLOSED: Final = "R2B313"


class DataError(R2bspecError):
    """A bag or dataset cannot be used as requested.

    The message names the file or the dataset; `hint` is the remedy.
    """

    code = BAG_NOT_FOUND
    exit_code = ExitStatus.USAGE

    def __init__(self, message: str, *, hint: str = "", code: str | None = None) -> None:
        # Names in bags may contain control characters, and this is printed to a terminal.
        super().__init__(printable(message), hint=printable(hint), code=code)


_DAMAGED_HINT: Final = "the file is damaged or incomplete; copy or record it again"


def unreadable(path: Path, reason: str, hint: str = _DAMAGED_HINT) -> DataError:
    """The error for a storage file that cannot be read (R2B304)."""
    return DataError(f"{path} cannot be read: {reason}", code=STORAGE_UNREADABLE, hint=hint)


def topic_not_found(owner: str, topic: str, topics: Iterable[str]) -> DataError:
    """The error for a topic that a recording does not have (R2B308)."""
    import difflib

    names = list(topics)
    close = difflib.get_close_matches(topic, names, n=1, cutoff=0.5)
    return DataError(
        f"{owner} has no topic {topic}",
        code=TOPIC_NOT_IN_BAG,
        hint=f"did you mean {close[0]}?"
        if close
        else f"its topics: {', '.join(sorted(names)) or 'none'}",
    )


def error_text(error: Exception) -> str:
    """The message of an error of the system or of a parser, on one line."""
    if isinstance(error, OSError) and error.errno is not None:
        return os.strerror(error.errno)
    if isinstance(error, AssertionError):
        return "its records contradict each other"
    return " ".join(str(error).split()) or type(error).__name__


def error_hint(error: Exception, default: str = _DAMAGED_HINT) -> str:
    """The hint for an error: of the system, or else `default`, for damaged files."""
    number = error.errno if isinstance(error, OSError) else None
    if number in {errno.EACCES, errno.EPERM}:
        return "you do not have permission to read it; see 'ls -l'"
    if number in {errno.ENOSPC, errno.EDQUOT}:
        return "compressed files are unpacked while they are read: free space in $TMPDIR"
    if number in {errno.EMFILE, errno.ENFILE}:
        return "too many files are open; see 'ulimit -n'"
    return default
