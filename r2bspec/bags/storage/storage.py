"""Opening the storage files of a bag in any format, with clear errors.

Also zstd, in which single messages and whole files of any format may be compressed.
"""

from __future__ import annotations

import errno
import importlib
import os
import shutil
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol, TypeVar

from r2bspec.bags import recording
from r2bspec.bags.metadata import check_not_lfs_pointer, normalise_type
from r2bspec.safe_io.decompression_budget import DecompressionBudget, unpack_zstd, zstd_size
from r2bspec.safe_io.limits import MAX_BAG_ENTRIES, MAX_NAME_CHARACTERS
from r2bspec.safe_io.private_files import temporary_folder
from r2bspec.safe_io.safe_file import RefusedDataError, open_regular

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

if TYPE_CHECKING:
    from rosbags.interfaces import Connection


def stored_topic(connection: Connection, count: int) -> recording.TopicInfo:
    """The topic of a connection, as `rosbags` has it, with the number of its messages."""
    return recording.TopicInfo(
        name=connection.topic,
        type=normalise_type(connection.msgtype),
        count=count,
        serialization=str(getattr(connection.ext, "serialization_format", "cdr")),
    )


def no_profiles(_: object) -> list[Any]:
    """In place of the QoS profiles that `rosbags` would parse."""
    return []


class Storage(Protocol):
    """One open storage file.

    Attributes:
        topics: one entry for each recorded publisher, so a topic may appear several times.
        message_count: over all topics.
        start_ns: time of the first message; meaningless without messages.
        end_ns: time of the last message; meaningless without messages.
    """

    topics: tuple[recording.TopicInfo, ...]
    message_count: int
    start_ns: int
    end_ns: int

    def timed_topics(self) -> Iterable[recording.TopicInfo]:
        """The topics, with the times of their first and last messages where an index tells them.

        It takes a search of the file, so that `topics` has no times.
        """
        ...

    def messages(self, selection: recording.Selection) -> Iterator[recording.RecordedMessage]:
        """The selected messages in time order, as CDR."""
        ...

    def close(self) -> None:
        """Close the file."""
        ...


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
        hint = error.hint if isinstance(error, RefusedDataError) else recording.error_hint(error)
        raise recording.unreadable(path, recording.error_text(error), hint) from error


def storage_paths(path: Path, files: tuple[str, ...]) -> tuple[Path, ...]:
    """The storage files of a bag; `path` is its folder, or the one file itself.

    Raises:
        DataError: one is missing (R2B303) or a Git LFS pointer (R2B305).
    """
    # Unlike the method of pathlib, this returns False for a name that is too long.
    if not os.path.exists(path):  # noqa: PTH110
        raise recording.DataError(
            f"{path} does not exist", code="R2B301", hint="check the path of the bag"
        )
    paths = tuple(path / name for name in files) if path.is_dir() else (path,)
    missing = [candidate.name for candidate in paths if not os.path.isfile(candidate)]  # noqa: PTH113
    if missing:
        raise recording.DataError(
            f"{path} has no {', '.join(missing)}, which its metadata.yaml names",
            code="R2B303",
            hint=f"copy the whole folder again, or run 'ros2 bag reindex {path}'",
        )
    for candidate in paths:
        with storage_errors(candidate):
            check_not_lfs_pointer(candidate)
    return paths


@contextmanager
def open_storages(paths: tuple[Path, ...], *, compressed_files: bool) -> Iterator[list[Storage]]:
    """Open storage files separately.

    With one reader per file, instead of one for the folder, topics are matched by the storage,
    which is correct even if metadata.yaml has another QoS, and files that overlap in time can be
    merged.

    Args:
        paths: the storage files.
        compressed_files: whether each is one zstd stream; they are unpacked to a temporary
            folder, because all formats need random access.

    Raises:
        DataError: a file is not readable storage (R2B304), or was not closed (R2B313).
    """
    with ExitStack() as stack:
        storages = []
        for path in paths:
            with storage_errors(path):
                plain = stack.enter_context(unpack(path)) if compressed_files else path
                storage = _open(plain, path)
                stack.callback(storage.close)
                DecompressionBudget(plain.stat().st_size).spend_messages(storage.message_count)
                names = [name for topic in storage.topics for name in (topic.name, topic.type)]
                check_topics(len(storage.topics), max(map(len, names), default=0))
            storages.append(storage)
        yield storages


def check_topics(number: int, longest: int) -> None:
    """Compare the topics of a file with the limits of metadata.yaml.

    Args:
        number: of the topics; one that several publishers recorded counts several times.
        longest: the length of the longest name of a topic or type.

    Raises:
        RefusedDataError: they exceed one.
    """
    if number > MAX_BAG_ENTRIES:
        raise RefusedDataError(f"it has {number:,} topics; the limit is {MAX_BAG_ENTRIES:,}")
    if longest > MAX_NAME_CHARACTERS:
        raise RefusedDataError(f"it has a name of {longest:,} characters")


def _open(path: Path, display_path: Path) -> Storage:
    """Open one file; `display_path` is what errors call it."""
    bag_format = recording.format_of_suffix(path.suffix)
    if bag_format is None:
        raise recording.DataError(
            f"{display_path} is not named as a storage file",
            code="R2B304",
            hint=f"storage files end in {recording.SUFFIXES_TEXT}; "
            "if it is compressed, metadata.yaml must say so",
        )
    reader: Callable[[Path, Path], Storage] = import_from_storage(bag_format.reader)
    return reader(path, display_path)


def import_from_storage(place: str) -> Any:
    """Import the object that ``module:name`` names in this package; nothing else is imported."""
    module, name = place.split(":")
    return getattr(importlib.import_module(f"{__package__}.{module}"), name)


Key = TypeVar("Key")

_MAGIC = b"\x28\xb5\x2f\xfd"
_BLOCK_BYTES = 1 << 20
_HEADER_BYTES = 18
_MIN_THREADED_BYTES = 1 << 16
_MAX_THREADS = 4


def decompress_message(data: bytes) -> bytes:
    """The CDR of a stored message.

    Compressed messages are recognised without a flag: CDR begins with a zero byte, a zstd frame
    with its magic number.

    Raises:
        ValueError: the bytes are neither, or unpack to too much.
    """
    if data[:4] == _MAGIC:
        data = unpack_zstd(data)
    if data[:1] != b"\x00":
        raise ValueError(
            f"a message begins with {data[:4].hex(' ') or 'no bytes'}, which is not CDR"
        )
    return data


def decompress_ahead(
    stored: Iterator[tuple[Key, bytes]], budget: DecompressionBudget
) -> Iterator[tuple[Key, bytes]]:
    """The CDR of stored messages, in their order; large ones are decompressed ahead in threads.

    zstd releases the interpreter lock, so that large messages are decompressed in parallel. Memory
    is bounded by one message per thread, and one more.

    Raises:
        ValueError: as `decompress_message`, at the position of the message.
    """
    workers = min(_MAX_THREADS, os.cpu_count() or 1)
    waiting: deque[tuple[Key, bytes | Future[bytes]]] = deque()
    with ExitStack() as stack:
        pool: ThreadPoolExecutor | None = None
        for what, data in stored:
            if len(data) >= _MIN_THREADED_BYTES and data[:4] == _MAGIC:
                pool = pool or stack.enter_context(ThreadPoolExecutor(workers))
                waiting.append((what, pool.submit(decompress_message, data)))
            else:
                waiting.append((what, data))
            while len(waiting) > (workers if pool else 0):
                yield _decompressed(*waiting.popleft(), budget)
        while waiting:
            yield _decompressed(*waiting.popleft(), budget)


def _decompressed(
    what: Key, data: bytes | Future[bytes], budget: DecompressionBudget
) -> tuple[Key, bytes]:
    if isinstance(data, Future):
        content = data.result()
        budget.spend(len(content))
        return what, content
    with budget.active():
        return what, decompress_message(data)


@contextmanager
def unpack(path: Path) -> Iterator[Path]:
    """A file that is one zstd stream, unpacked for as long as the block lasts.

    Yields:
        A file in a temporary folder, named like `path` without its last suffix.

    Raises:
        RefusedDataError: it unpacks to too much.
        OSError: there is no space in $TMPDIR.
        EOFError, zstd.ZstdError: the file is damaged.
    """
    with temporary_folder("unpacked") as folder:
        plain = folder / path.stem
        with open_regular(path) as stored, plain.open("wb") as unpacked:
            _unpack_file(stored, unpacked)
        yield plain


def _unpack_file(stored: BinaryIO, unpacked: BinaryIO) -> None:
    """Unpack a whole file; what it states is compared with the limits and the room first."""
    stored_bytes = os.fstat(stored.fileno()).st_size
    stated = zstd_size(stored.read(_HEADER_BYTES)) or 0
    DecompressionBudget(stored_bytes).spend(stated)
    if stated > shutil.disk_usage(unpacked.fileno()).free:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    stored.seek(0)
    budget = DecompressionBudget(stored_bytes)
    with zstd.open(stored, "rb") as packed:
        while block := packed.read(_BLOCK_BYTES):
            budget.spend(len(block))
            unpacked.write(block)
