"""Writing files atomically."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from r2bspec.record.errors import RUN_UNWRITABLE, RecordError


def write_atomically(path: Path, content: bytes | Callable[[BinaryIO], object]) -> None:
    """Write a file so that other processes see the old or the new content, never a part.

    The content is written to a temporary file in the same folder, synchronised to the disk, and
    renamed to `path`; parent folders are created. A crash at any time leaves at most a hidden file
    whose name ends in ``.tmp``.

    Args:
        path: the file to write; replaced if it exists.
        content: the bytes, or a function that writes them to an open binary file.

    Raises:
        RecordError: the file cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.urandom(4).hex()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("xb") as file:
            if callable(content):
                content(file)
            else:
                file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        raise RecordError(
            f"{path} cannot be written: {error.strerror or error}",
            hint="Choose another folder with --output, or free space on this disk.",
            code=RUN_UNWRITABLE,
        ) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def _sync_folder(folder: Path) -> None:
    """Synchronise a rename in `folder` to the disk, if the file system supports it."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
