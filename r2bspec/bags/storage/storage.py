"""Opening the storage files of a bag in any format, with clear errors."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from r2bspec.bags.compression import unpack
from r2bspec.bags.errors import (
    BAG_NOT_FOUND,
    STORAGE_MISSING,
    STORAGE_UNREADABLE,
    DataError,
    error_hint,
    error_text,
)
from r2bspec.bags.metadata import MAX_ENTRIES, MAX_NAME_LENGTH, check_not_lfs_pointer
from r2bspec.bags.recording import Message
from r2bspec.language.bag_formats import SUFFIXES_TEXT, format_of_suffix
from r2bspec.untrusted.errors import RefusedDataError


@dataclass(frozen=True)
class StoredTopic:
    """A topic of one storage file; the type is normalised."""

    name: str
    type: str
    serialization: str
    count: int


class Storage(Protocol):
    """One open storage file.

    Attributes:
        topics: one entry for each recorded publisher, so a topic may appear several times.
        message_count: over all topics.
        start_ns: time of the first message; meaningless without messages.
        end_ns: time of the last message; meaningless without messages.
    """

    topics: tuple[StoredTopic, ...]
    message_count: int
    start_ns: int
    end_ns: int

    def messages(
        self, names: Collection[str], start_ns: int | None, stop_ns: int | None
    ) -> Iterator[Message]:
        """The messages of these topics with start <= time < stop, in time order, as CDR."""
        ...

    def close(self) -> None:
        """Close the file."""
        ...


StorageReader = Callable[[Path, Path], Storage]
"""Opens a file; its second argument is what errors call the file."""


@contextmanager
def storage_errors(path: Path) -> Iterator[None]:
    """Convert all exceptions of a storage parser to DataError (R2B304).

    For damaged files, the parsers raise struct, index, type, database and decompression errors,
    which may change with their versions.
    """
    try:
        yield
    except DataError:
        raise
    except Exception as error:
        raise DataError(
            f"{path} cannot be read: {error_text(error)}",
            code=STORAGE_UNREADABLE,
            hint=error.hint if isinstance(error, RefusedDataError) else error_hint(error),
        ) from error


def storage_paths(path: Path, files: tuple[str, ...]) -> tuple[Path, ...]:
    """The storage files of a bag; `path` is its folder, or the one file itself.

    Raises:
        DataError: one is missing (R2B303) or a Git LFS pointer (R2B305).
    """
    # Unlike the method of pathlib, this returns False for a name that is too long.
    if not os.path.exists(path):  # noqa: PTH110
        raise DataError(
            f"{path} does not exist", code=BAG_NOT_FOUND, hint="check the path of the bag"
        )
    paths = tuple(path / name for name in files) if path.is_dir() else (path,)
    missing = [candidate.name for candidate in paths if not os.path.isfile(candidate)]  # noqa: PTH113
    if missing:
        raise DataError(
            f"{path} has no {', '.join(missing)}, which its metadata.yaml names",
            code=STORAGE_MISSING,
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
                names = [name for each in storage.topics for name in (each.name, each.type)]
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
    if number > MAX_ENTRIES:
        raise RefusedDataError(f"it has {number:,} topics; the limit is {MAX_ENTRIES:,}")
    if longest > MAX_NAME_LENGTH:
        raise RefusedDataError(f"it has a name of {longest:,} characters")


def _open(path: Path, display_path: Path) -> Storage:
    """Open one file; `display_path` is what errors call it."""
    found = format_of_suffix(path.suffix)
    if found is None:
        raise DataError(
            f"{display_path} is not named as a storage file",
            code=STORAGE_UNREADABLE,
            hint=f"storage files end in {SUFFIXES_TEXT}; "
            "if it is compressed, metadata.yaml must say so",
        )
    reader: StorageReader = import_from_storage(found.reader)
    return reader(path, display_path)


def import_from_storage(place: str) -> Any:
    """Import the object that ``module:name`` names in this package; nothing else is imported."""
    module, name = place.split(":")
    return getattr(importlib.import_module(f"{__package__}.{module}"), name)
