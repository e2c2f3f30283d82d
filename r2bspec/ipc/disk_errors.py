"""Errors of a disk that takes no more, with the file that could not be written."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterator
from pathlib import Path

_REFUSALS = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS})


@contextlib.contextmanager
def named_errors(path: Path) -> Iterator[None]:
    """Add the name of a file to errors of the system, which does not give it for an open file."""
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = str(path)
        raise


def is_refusal(error: OSError) -> bool:
    """Whether it says that the disk, or a limit of the user, has no room for what is written."""
    return error.errno in _REFUSALS


def refusal_text(error: OSError) -> str:
    """The error with its file, where that is known."""
    what = error.filename or "a file of the run"
    return f"{what} cannot be written: {error.strerror or error}"
