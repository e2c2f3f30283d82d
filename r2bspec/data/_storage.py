"""Opening the storage files of a bag through `rosbags`, with errors a person can use."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from r2bspec.data._metadata import refuse_lfs_pointer
from r2bspec.data.errors import (
    BAG_NOT_FOUND,
    STORAGE_MISSING,
    STORAGE_UNREADABLE,
    DataError,
)

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

if TYPE_CHECKING:
    from rosbags.rosbag2 import Reader

STORAGE_SUFFIXES = {".db3": "sqlite3", ".mcap": "mcap"}

_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


@contextmanager
def reported(path: Path) -> Iterator[None]:
    """Turn whatever a storage parser raises on damaged input into one DataError (R2B304).

    The parsers of damaged files raise struct, index, type, database and decompression errors;
    naming each would only list today's.
    """
    try:
        yield
    except DataError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise DataError(
            f"{path} cannot be read: {reason}",
            code=STORAGE_UNREADABLE,
            hint="the file is damaged or incomplete; copy or record it again",
        ) from error


def storage_paths(path: Path, files: tuple[str, ...]) -> tuple[Path, ...]:
    """The storage files of a bag; `path` is its folder, or the one file itself.

    Raises:
        DataError: one is missing (R2B303) or a Git LFS pointer (R2B305).
    """
    if not path.exists():
        raise DataError(
            f"{path} does not exist", code=BAG_NOT_FOUND, hint="check the path of the bag"
        )
    paths = tuple(path / name for name in files) if path.is_dir() else (path,)
    missing = [candidate.name for candidate in paths if not candidate.is_file()]
    if missing:
        raise DataError(
            f"{path} lacks {', '.join(missing)}, which its metadata.yaml names",
            code=STORAGE_MISSING,
            hint=f"copy the whole folder again, or run 'ros2 bag reindex {path}'",
        )
    for candidate in paths:
        with reported(candidate):
            refuse_lfs_pointer(candidate)
    return paths


@contextmanager
def open_storages(paths: tuple[Path, ...], *, compressed_files: bool) -> Iterator[list[Reader]]:
    """Open storage files, each with its own reader.

    One reader per file, and not one for the folder: topics are then matched by what the storage
    says, which is right where metadata.yaml disagrees about QoS, and files that overlap in time
    can be merged.

    Args:
        paths: the storage files.
        compressed_files: whether each is one zstd stream; they are unpacked to a temporary
            folder, because both formats need random access.

    Raises:
        DataError: a file is no readable storage (R2B304).
    """
    from rosbags.rosbag2 import Reader

    with ExitStack() as stack:
        if compressed_files:
            paths = tuple(_unpack(path, stack) for path in paths)
        readers = []
        for path in paths:
            with reported(path):
                readers.append(stack.enter_context(Reader(path)))
        yield readers


def _unpack(path: Path, stack: ExitStack) -> Path:
    import shutil
    import tempfile

    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="r2bspec-")))
    plain = folder / path.stem
    with reported(path), zstd.open(path, "rb") as packed, plain.open("wb") as unpacked:
        shutil.copyfileobj(packed, unpacked)
    return plain


def uncompressed(data: bytes) -> bytes:
    """The CDR of a stored message.

    No flag is needed to tell compressed messages: CDR begins with a zero byte, a zstd frame
    with its magic number.

    Raises:
        ValueError: the bytes are neither.
    """
    if data[:4] == _ZSTD_MAGIC:
        data = zstd.decompress(data)
    if data[:1] != b"\x00":
        msg = f"a message begins with {data[:4].hex(' ') or 'nothing'}, which is no CDR"
        raise ValueError(msg)
    return data


def uncompressed_size(head: bytes, stored_bytes: int) -> int | None:
    """Size of a stored message in bytes, from its first bytes; None if they do not tell."""
    if head[:4] != _ZSTD_MAGIC:
        return stored_bytes
    return zstd.get_frame_info(head).decompressed_size
