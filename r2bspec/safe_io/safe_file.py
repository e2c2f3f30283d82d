"""Opening files: regular ones only, without leaving the allowed folders, up to a size.

What is refused before its content is used is an error of this module. Files that an editor has
changed and not saved are read with its texts.
"""

from __future__ import annotations

import contextlib
import io
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextvars import ContextVar
from pathlib import Path
from typing import BinaryIO, Final

from r2bspec.errors import ExitStatus, R2bspecError


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


_TEXTS: Final[ContextVar[Mapping[Path, str]]] = ContextVar("unsaved_files")


@contextlib.contextmanager
def unsaved_files(texts: Mapping[Path, str]) -> Iterator[None]:
    """Read these files with these texts in the block.

    Args:
        texts: by the resolved path of the file, which must exist on disk.
    """
    token = _TEXTS.set(texts)
    try:
        yield
    finally:
        _TEXTS.reset(token)


def unsaved_content(path: Path) -> bytes | None:
    """Return the content of a file that is open and not saved; None for all others."""
    texts = _TEXTS.get({})
    text = texts.get(path.resolve()) if texts else None
    return None if text is None else text.encode("utf-8", "surrogatepass")


_KERNEL_FOLDERS: Final = ("/proc/", "/sys/")
"""Their regular files have no size, may block, and tell about this machine."""

_KINDS: Final = (
    (stat.S_ISDIR, "it is a folder, not a file"),
    (stat.S_ISFIFO, "it is a pipe, not a regular file"),
    (stat.S_ISCHR, "it is a device, not a regular file"),
    (stat.S_ISBLK, "it is a device, not a regular file"),
)
_BLOCK_BYTES: Final = 1 << 20


def open_regular(path: Path, *, folders: Iterable[Path] | None = None) -> BinaryIO:
    """Open a regular file for reading.

    Args:
        path: the file; links are followed.
        folders: where the file itself must be, after all links; None for anywhere.

    Raises:
        RefusedFileError: it is no regular file, or outside of these folders.
        OSError: the system refuses.
    """
    try:
        # Without O_NONBLOCK, opening a pipe waits until another process opens it for writing.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
    except ValueError:
        raise RefusedFileError("its name contains a NUL character") from None
    try:
        _check_kind(os.fstat(descriptor).st_mode)
        _check_place(path, folders)
        return os.fdopen(descriptor, "rb")
    except RefusedFileError:
        os.close(descriptor)
        raise


def read_bytes(
    path: Path,
    *,
    max_bytes: int,
    folders: Iterable[Path] | None = None,
) -> bytes:
    """Return the content of a regular file, read once.

    Args:
        path: as for `open_regular`.
        max_bytes: the most that is read.
        folders: as for `open_regular`.

    Raises:
        TooLargeError: it has more bytes.
        RefusedFileError: as `open_regular`.
        OSError: the system refuses.
    """
    with open_regular(path, folders=folders) as opened:
        unsaved = unsaved_content(path)
        file = opened if unsaved is None else io.BytesIO(unsaved)
        blocks, left = [], max_bytes + 1
        while left and (block := file.read(min(left, _BLOCK_BYTES))):
            blocks.append(block)
            left -= len(block)
    if not left:
        raise TooLargeError(f"it is larger than {max_bytes:,} bytes")
    return b"".join(blocks)


def read_text(
    path: Path,
    *,
    max_bytes: int,
    folders: Iterable[Path] | None = None,
) -> str:
    """Return the content of a file in UTF-8; arguments and errors as for `read_bytes`.

    Raises:
        RefusedFileError: it is not UTF-8, or as `read_bytes`.
        OSError: the system refuses.
    """
    content = read_bytes(path, max_bytes=max_bytes, folders=folders)
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise RefusedFileError(f"it is not UTF-8 (line {line})") from None


def is_regular(path: Path) -> bool:
    """Return True if a path leads to a regular file; False for an impossible name."""
    return stat.S_ISREG(_mode(path))


def is_there(path: Path) -> bool:
    """Return True if a path leads to anything; False for an impossible name."""
    return _mode(path) != 0


def is_folder(path: Path) -> bool:
    """Return True if a path leads to a folder; False for an impossible name."""
    return stat.S_ISDIR(_mode(path))


def _mode(path: Path) -> int:
    """Return the kind of what a path leads to, and who may use it; 0 if there is nothing."""
    try:
        return path.stat().st_mode
    except (OSError, ValueError):
        return 0


def names_in(folder: Path) -> list[str]:
    """Return the names of everything in a folder, sorted.

    Raises:
        OSError: there is no such folder, or the system refuses.
    """
    return sorted(os.listdir(folder))  # noqa: PTH208 - names alone are asked for


def names_if_any(folder: Path) -> list[str]:
    """Return the names in a folder, sorted; empty if it does not exist or cannot be read."""
    try:
        return names_in(folder)
    except OSError:
        return []


def _check_kind(mode: int) -> None:
    for is_kind, reason in _KINDS if not stat.S_ISREG(mode) else ():
        if is_kind(mode):
            hint = "use '-' to read standard input" if stat.S_ISFIFO(mode) else ""
            raise RefusedFileError(reason, hint=hint)


def _check_place(path: Path, folders: Iterable[Path] | None) -> None:
    real = real_path(path)
    if str(real).startswith(_KERNEL_FOLDERS):
        raise OutsideFolderError("it is a kernel file, not a file on a disk")
    if folders is not None and not any(
        real.is_relative_to(real_path(folder)) for folder in folders
    ):
        raise OutsideFolderError("it is a link out of its folder")


def real_path(path: Path) -> Path:
    """Return a path without links; as it is if it cannot be resolved."""
    try:
        return path.resolve()
    except (OSError, ValueError, RuntimeError):
        return path.absolute()
