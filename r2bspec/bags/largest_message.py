"""The largest message of each topic of a recorded bag, from lengths instead of bodies."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.bag_reader import check_window, read_messages, resolve_topics
from r2bspec.bags.compression import uncompressed_size
from r2bspec.bags.errors import STORAGE_UNREADABLE, DataError
from r2bspec.bags.recording import BagIndex, Window
from r2bspec.bags.storage.storage import storage_errors, storage_paths

if TYPE_CHECKING:
    import sqlite3

# The longest header of a zstd frame, magic number included.
_MAX_FRAME_HEADER_BYTES = 18


def measure_largest(path: Path, topics: Collection[str], window: Window | None = None) -> int:
    """Size in bytes of the largest message of any of the topics; 0 where there is none.

    Raises:
        DataError: as `read_messages`.
    """
    return max(measure_largest_by_topic(path, topics, window).values(), default=0)


def measure_largest_by_topic(
    path: Path, topics: Collection[str], window: Window | None = None
) -> dict[str, int]:
    """Size in bytes of the largest uncompressed message of each topic; 0 where there is none.

    In sqlite3 storage only lengths and first bytes are read. MCAP packs messages into compressed
    chunks, and of sqlite3 files that are compressed as a whole nothing can be seen either: those
    are read, so give the window that will be read anyway.

    Args:
        path: bag folder or storage file.
        topics: as for `read_messages`.
        window: as for `read_messages`.

    Returns:
        By recorded topic name.

    Raises:
        DataError: as `read_messages`.
    """
    path = Path(path)
    index = index_bag(path)
    names = resolve_topics(path, index, topics)
    check_window(path, index, window)
    largest = dict.fromkeys(sorted(names), 0)
    if index.storage == "sqlite3" and index.compression != "file":
        for file in storage_paths(path, index.files):
            with storage_errors(file):
                _measure_sqlite(file, largest, index, window or Window())
    else:
        for message in read_messages(path, names, window):
            largest[message.topic] = max(largest[message.topic], len(message.data))
    return largest


def _measure_sqlite(file: Path, largest: dict[str, int], index: BagIndex, window: Window) -> None:
    import sqlite3

    first_ns = index.start_ns + window.start_ns
    past_ns = 2**63 - 1 if window.end_ns is None else index.start_ns + window.end_ns
    # A recording may lie on a read-only disk, where no lock file can be made.
    with closing(sqlite3.connect(f"{file.resolve().as_uri()}?immutable=1", uri=True)) as database:
        for topic in largest:
            rows = database.execute(
                "SELECT messages.rowid, length(messages.data) FROM messages"
                " JOIN topics ON messages.topic_id = topics.id"
                " WHERE topics.name = ? AND messages.timestamp >= ? AND messages.timestamp < ?",
                (topic, first_ns, past_ns),
            )
            for row, stored_bytes in rows:
                size = _message_size(file, database, row, stored_bytes)
                largest[topic] = max(largest[topic], size)


def _message_size(file: Path, database: sqlite3.Connection, row: int, stored_bytes: int) -> int:
    with database.blobopen("messages", "data", row, readonly=True) as blob:
        size = uncompressed_size(blob.read(_MAX_FRAME_HEADER_BYTES), stored_bytes)
    if size is None:
        raise DataError(
            f"{file} has a compressed message without its uncompressed size",
            code=STORAGE_UNREADABLE,
            hint="convert the bag with 'ros2 bag convert'",
        )
    return size
