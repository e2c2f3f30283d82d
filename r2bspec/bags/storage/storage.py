"""Opening the storage files of a bag in any format, with clear errors.

It also handles zstd, which may compress single messages and whole files of any format.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final, Protocol

import msgspec

from r2bspec.bags import recording
from r2bspec.bags.metadata import check_not_lfs_pointer, normalise_type
from r2bspec.safe_io.private_files import temporary_folder
from r2bspec.safe_io.safe_file import open_regular

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd


class DamagedStorageError(ValueError):
    """A storage file is damaged or useless; `hint` is the remedy."""

    def __init__(self, reason: str, hint: str = "") -> None:
        super().__init__(reason)
        self.hint = hint


EMPTY_FILE: Final = "it is empty, as after a crash of the recorder"


class Storage(Protocol):
    """An open storage file."""

    def index(self) -> tuple[recording.TopicInfo, ...]:
        """Return a topic for each recorded publisher, so a name may appear several times."""
        ...

    def messages(self, selection: recording.Selection) -> Iterator[recording.RecordedMessage]:
        """Yield the selected messages in time order, as CDR."""
        ...

    def times(self) -> Iterator[tuple[str, int]] | None:
        """Return the topic and the time of recording of each message, in any order.

        None if only reading the messages would tell.
        """
        ...

    def close(self) -> None:
        """Close the file."""
        ...


def stored_topic(
    name: object,
    kind: object,
    serialization: object,
    count: object,
    span_ns: tuple[object, object] | None,
    qos: object = "",
) -> recording.TopicInfo:
    """Return the topic with these values, whose types are checked.

    Raises:
        msgspec.ValidationError: a value is of another type, as in a damaged file.
    """
    first_ns, last_ns = span_ns or (None, None)
    topic = msgspec.convert(
        {
            "name": name,
            "type": kind,
            "serialization": serialization,
            "count": count,
            "first_ns": first_ns,
            "last_ns": last_ns,
            "qos": qos or "",
        },
        recording.TopicInfo,
    )
    return msgspec.structs.replace(topic, type=normalise_type(topic.type))


@contextmanager
def storage_errors(path: Path) -> Iterator[None]:
    """Convert all exceptions of a storage parser to DataError (R2B304).

    For damaged files, the parsers raise struct, index, type, database and decompression errors,
    which may change with their versions.
    """
    try:
        yield
    except recording.DataError:
        raise
    except Exception as error:
        hint = getattr(error, "hint", "") or recording.error_hint(error)
        raise recording.unreadable(path, recording.error_text(error), hint) from error


_MAGIC = b"\x28\xb5\x2f\xfd"
PACKED: Final = ".zstd"
"""The last suffix of a storage file that is compressed as a whole."""


def storage_files(folder: Path) -> tuple[str, ...]:
    """Return the names of the storage files in a folder, sorted."""
    suffixes = tuple(recording.SUFFIXES.values())
    return tuple(
        sorted(
            file.name
            for file in folder.iterdir()
            if file.name.removesuffix(PACKED).endswith(suffixes) and file.is_file()
        )
    )


def storage_paths(path: Path, files: tuple[str, ...]) -> tuple[Path, ...]:
    """Return the storage files of a bag; `path` is its folder, or the file itself.

    A recorder that compresses its files may have written metadata.yaml before or after that, so a
    file may be compressed or not, whatever its name there.

    Raises:
        DataError: one is missing (R2B303) or a Git LFS pointer (R2B305).
    """
    # Unlike the method of pathlib, this returns False for a name that is too long.
    if not os.path.exists(path):  # noqa: PTH110
        raise recording.DataError(
            f"{path} does not exist", code="R2B301", hint="check the path of the bag"
        )
    paths = tuple(_stored(path, name) for name in files) if path.is_dir() else (path,)
    missing = [candidate.name for candidate in paths if not os.path.isfile(candidate)]  # noqa: PTH113
    if missing:
        raise recording.DataError(
            f"{path} has no {', '.join(missing)}, which its metadata.yaml names",
            code="R2B303",
            hint=other_files_hint(path, storage_files(path)),
        )
    for candidate in paths:
        with storage_errors(candidate):
            check_not_lfs_pointer(candidate)
    return paths


def _stored(folder: Path, name: str) -> Path:
    """Return a file of a bag; early versions of metadata.yaml include the name of the folder."""
    path = folder / name
    places = (path, folder / path.name)
    candidates = [place for each in places for place in (each, _packed_or_not(each))]
    return next((each for each in candidates if os.path.isfile(each)), places[1])  # noqa: PTH113


def _packed_or_not(path: Path) -> Path:
    return path.with_suffix("") if path.suffix == PACKED else path.with_name(path.name + PACKED)


def other_files_hint(folder: Path, files: tuple[str, ...]) -> str:
    """Return what to do about a metadata.yaml that does not name these storage files."""
    inner = sorted(place.name for place in folder.iterdir() if place.is_dir())
    moved = next((name for name in inner if storage_files(folder / name)), "")
    if moved and not files:
        return f"move the files of {folder / moved} to {folder}"
    if not files:
        return "copy the whole folder again: it has no storage file"
    return (
        f"copy the whole folder again; or write metadata.yaml anew for {', '.join(files)} with "
        f"'ros2 bag reindex {folder}', or name such a file in place of the folder"
    )


def is_packed(path: Path) -> bool:
    """Return True if a storage file is compressed as a whole.

    Raises:
        OSError: it cannot be opened.
    """
    with open_regular(path) as stream:
        return stream.read(len(_MAGIC)) == _MAGIC


@contextmanager
def open_storages(paths: tuple[Path, ...]) -> Iterator[list[Storage]]:
    """Open storage files separately.

    With a reader for each file, instead of one for the folder, topics are matched by the storage,
    which is correct even if metadata.yaml has another QoS, and files that overlap in time can be
    merged.

    Args:
        paths: the storage files. Those that are one zstd stream are unpacked to a temporary
            folder, because all formats need random access.

    Raises:
        DataError: a file is not readable storage (R2B304), or was not closed (R2B313).
    """
    with ExitStack() as stack:
        storages = []
        for path in paths:
            with storage_errors(path):
                plain = stack.enter_context(_unpacked(path)) if is_packed(path) else path
                storage = _reader(plain)(plain)
                stack.callback(storage.close)
            storages.append(storage)
        yield storages


def _reader(path: Path) -> Callable[[Path], Storage]:
    """Return the class that opens a storage file.

    Raises:
        DamagedStorageError: its name has no suffix of a format.
    """
    if path.suffix == recording.SUFFIXES["sqlite3"]:
        from r2bspec.bags.storage.sqlite import SqliteStorage

        return SqliteStorage
    if path.suffix == recording.SUFFIXES["mcap"]:
        from r2bspec.bags.storage.mcap import McapStorage

        return McapStorage
    raise DamagedStorageError(
        f"{path.name} is not named as a storage file",
        f"storage files end in {recording.SUFFIXES_TEXT}, and then in {PACKED} if compressed",
    )


def decompress_message(data: bytes) -> bytes:
    """Return the CDR of a stored message.

    Compressed messages are recognised without a flag: CDR begins with a zero byte, a zstd frame
    with its magic number.

    Raises:
        ValueError, zstd.ZstdError: the bytes are neither.
    """
    if data[:4] == _MAGIC:
        data = zstd.decompress(data)
    if data[:1] != b"\x00":
        raise ValueError(
            f"a message begins with {data[:4].hex(' ') or 'no bytes'}, which is not CDR"
        )
    return data


@contextmanager
def _unpacked(path: Path) -> Iterator[Path]:
    """Unpack a file that is one zstd stream for as long as the block lasts.

    Yields:
        A file in a temporary folder, named like `path` without its last suffix.

    Raises:
        OSError: there is no space in $TMPDIR.
        EOFError, zstd.ZstdError: the file is damaged.
    """
    with temporary_folder("unpacked") as folder:
        plain = folder / path.name.removesuffix(PACKED)
        with (
            open_regular(path) as stored,
            zstd.open(stored, "rb") as packed,
            plain.open("wb") as unpacked,
        ):
            shutil.copyfileobj(packed, unpacked)
        yield plain
