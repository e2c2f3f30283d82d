"""Reading messages of a bag in time order, as the bytes that a publisher sent."""

from __future__ import annotations

import difflib
import heapq
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from r2bspec.data._metadata import normalise_type
from r2bspec.data._storage import open_storages, reported, storage_paths, uncompressed
from r2bspec.data.errors import (
    SERIALIZATION_UNSUPPORTED,
    STORAGE_UNREADABLE,
    TOPIC_NOT_IN_BAG,
    WINDOW_OUTSIDE_BAG,
    DataError,
)
from r2bspec.data.index import index_bag
from r2bspec.data.model import BagIndex, Message, Window

if TYPE_CHECKING:
    from rosbags.rosbag2 import Reader


def read_messages(
    path: Path, topics: Collection[str], window: Window | None = None
) -> Iterator[Message]:
    """Yield the messages of the named topics in time order; equal times in stored order.

    Memory is bounded by a few messages (sqlite3) or chunks (MCAP). Only the named topics are
    touched: others may have any type or serialization. The arguments are checked before the
    first message is asked for.

    Args:
        path: bag folder or storage file.
        topics: names as in the index; a leading slash more or less makes no difference.
        window: relative to the index's `start_ns`; None for everything.

    Raises:
        DataError: as `index_bag`; a topic is not there (R2B308) or not CDR (R2B306); the window
            lies outside the bag (R2B309); while iterating, damaged storage (R2B304).
    """
    path = Path(path)
    index = index_bag(path)
    names = resolve_topics(path, index, topics)
    check_window(path, index, window)
    return _read(path, index, names, window)


def resolve_topics(path: Path, index: BagIndex, topics: Collection[str]) -> frozenset[str]:
    """The recorded names of topics that can be read.

    Raises:
        DataError: R2B306 or R2B308.
    """
    names = set()
    for topic in topics:
        info = index.find(topic)
        if info is None:
            close = difflib.get_close_matches(topic, index.topics, n=1, cutoff=0.5)
            raise DataError(
                f"{path} has no topic {topic}",
                code=TOPIC_NOT_IN_BAG,
                hint=f"did you mean {close[0]}?"
                if close
                else f"it has {', '.join(index.topics) or 'no topics at all'}",
            )
        if info.serialization != "cdr":
            raise DataError(
                f"{path} holds {info.name} serialised as {info.serialization!r}; only 'cdr' is"
                " readable",
                code=SERIALIZATION_UNSUPPORTED,
                hint="convert the bag with 'ros2 bag convert' where that format is installed",
            )
        names.add(info.name)
    return frozenset(names)


def check_window(path: Path | str, index: BagIndex, window: Window | None) -> None:
    """Refuse a window that is empty or begins after the last message.

    Raises:
        DataError: R2B309.
    """
    if window is None:
        return
    if window.start_ns < 0 or (window.end_ns is not None and window.end_ns <= window.start_ns):
        raise DataError(
            f"the window from {window.start_ns / 1e9:g} s to {(window.end_ns or 0) / 1e9:g} s of"
            f" {path} is empty",
            code=WINDOW_OUTSIDE_BAG,
            hint="its end must come after its start, and its start not before 0 s",
        )
    if index.message_count and window.start_ns > index.duration_ns:
        raise DataError(
            f"the window begins at {window.start_ns / 1e9:g} s, but {path} ends after"
            f" {index.duration_ns / 1e9:g} s",
            code=WINDOW_OUTSIDE_BAG,
            hint="windows count from the start of the bag",
        )


def _read(
    path: Path, index: BagIndex, names: frozenset[str], window: Window | None
) -> Iterator[Message]:
    if not names or not index.message_count:
        return
    start_ns = stop_ns = None
    if window is not None:
        start_ns = index.start_ns + window.start_ns
        stop_ns = None if window.end_ns is None else index.start_ns + window.end_ns
    paths = storage_paths(path, index.files)
    with open_storages(paths, compressed_files=index.compression == "file") as readers:
        streams = [
            _read_file(file, reader, names, start_ns, stop_ns)
            for file, reader in zip(paths, readers, strict=True)
            if reader.message_count
        ]
        # The files of a split recording overlap where writers were buffered.
        yield from heapq.merge(*streams, key=lambda message: message.time_ns)


def _read_file(
    file: Path, reader: Reader, names: frozenset[str], start_ns: int | None, stop_ns: int | None
) -> Iterator[Message]:
    connections = [each for each in reader.connections if each.topic in names]
    types: dict[str, str] = {}
    for each in connections:
        kind = normalise_type(each.msgtype)
        if types.setdefault(each.topic, kind) != kind:
            raise DataError(
                f"{file} holds {each.topic} as {types[each.topic]} and as {kind}",
                code=STORAGE_UNREADABLE,
                hint="a topic can be played with one type only",
            )
    if not connections:
        return
    with reported(file):
        for connection, time_ns, data in reader.messages(connections, start_ns, stop_ns):
            yield Message(topic=connection.topic, time_ns=time_ns, data=uncompressed(data))
