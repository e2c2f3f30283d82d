"""What is known of a bag at low cost: its index, and the messages in the window.

Indexing a bag opens all of its files, which for a bag of many files takes longer than all rules
together. The indexes of large bags are therefore kept in the cache of the user. The key of an index
has the size, times and inode of each file, so a changed bag is indexed again. If the cache cannot
be read or written, or others can change it, bags are indexed without it.

Counts of rendered datasets and of whole bags are exact. Other counts are estimated from the mean
rate; if the estimate is low, the messages are read.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterator
from functools import cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from r2bspec.bags.recording import BagIndex, BagLocation, DataError, RecordedMessage, TimeWindow
from r2bspec.datasets.catalogue import describe
from r2bspec.datasets.catalogue import index as index_location
from r2bspec.private_files import private_files
from r2bspec.safe_io.cache_folder import cache_folder
from r2bspec.safe_io.limits import MAX_BAG_INDEX_BYTES, MAX_STAMPS_BYTES
from r2bspec.safe_io.safe_json import read_json

if TYPE_CHECKING:
    from r2bspec.check.check_context import Context

_CACHE_VERSION = 2
"""Increase this with every change of the content of an index."""

_MAX_FILES = 10_000
_MIN_CACHED_BYTES = 1_000_000
"""Smaller bags are indexed faster than a cache is read."""


def cached_index(location: BagLocation) -> BagIndex:
    """The index of a located bag.

    Raises:
        DataError: the bag cannot be used; errors are not cached.
    """
    if location.path is None:
        return index_location(location)
    from r2bspec.safe_io.decompression_budget import chosen_max_bytes

    entry = _cache_file(location.path)
    # What was indexed under other limits may be more than the user allows now.
    if entry is None or chosen_max_bytes() is not None:
        return index_location(location)
    with contextlib.suppress(OSError, msgspec.DecodeError):
        return read_json(entry, BagIndex, max_bytes=MAX_BAG_INDEX_BYTES)
    content = index_location(location)
    _store(entry, msgspec.json.encode(content))
    return content


def _cache_file(bag: Path) -> Path | None:
    """The cache file for the index of a bag; None if the bag is not worth caching."""
    try:
        files = sorted(bag.iterdir()) if bag.is_dir() else [bag]
        stats = [(file, file.stat()) for file in files[:_MAX_FILES]]
    except OSError:
        return None
    if len(files) > _MAX_FILES or sum(stat.st_size for _, stat in stats) < _MIN_CACHED_BYTES:
        return None
    identity = hashlib.sha256(f"{_CACHE_VERSION}\0{bag.resolve()}\0".encode())
    for file, stat in stats:
        values = (file.name, stat.st_size, stat.st_mtime_ns, stat.st_ino, stat.st_ctime_ns)
        identity.update(repr(values).encode())
    with contextlib.suppress(OSError):
        return cache_folder("indexes") / f"{identity.hexdigest()}.json"
    return None


def _store(entry: Path, content: bytes) -> None:
    scratch = entry.with_name(f".{entry.name}.{os.getpid()}")
    try:
        # Names of topics are not for other users, and no other user may exchange an entry.
        with private_files():
            scratch.write_bytes(content)
        scratch.replace(entry)
    except OSError:
        scratch.unlink(missing_ok=True)


_MIN_ESTIMATED_MESSAGES = 5
"""Below this number an estimate is useless, and reading the messages is cheap."""


class MessageCount(msgspec.Struct, frozen=True):
    """A number of messages; `exact` is False for an estimate from the mean rate."""

    messages: int
    exact: bool


def window_message_counts(context: Context) -> dict[str, MessageCount]:
    """The messages in the window of each loaded topic that the bag contains."""
    bag = context.bag
    if bag is None:
        return {}
    window = context.spec.data_loader.window
    start_ns = window.start.ns
    end_ns = bag.duration_ns + 1 if window.end is None else window.end.ns
    counts = {}
    for name in context.spec.data_loader.topics:
        info = bag.find(name)
        if info is None:
            continue
        if start_ns == 0 and end_ns > bag.duration_ns:
            counts[name] = MessageCount(info.count, exact=True)
        elif context.is_rendered:
            rendered = _count_rendered(bag.name, info.name, start_ns, end_ns)
            counts[name] = MessageCount(rendered, exact=True)
        else:
            length_s = (min(end_ns, bag.duration_ns) - start_ns) / 1e9
            counts[name] = MessageCount(round(info.rate_hz * max(length_s, 0)), exact=False)
            if counts[name].messages < _MIN_ESTIMATED_MESSAGES:
                counts[name] = _count_by_reading(context, info.name)
    return counts


@cache  # of a pure function: the catalogue and its datasets do not change
def _count_rendered(name: str, topic: str, start_ns: int, end_ns: int) -> int:
    try:
        index = describe(name, {topic}, TimeWindow(start_ns=start_ns, end_ns=end_ns))
    except DataError:
        return 0
    return index.message_count


def _count_by_reading(context: Context, topic: str) -> MessageCount:
    """Count by reading, up to _MIN_ESTIMATED_MESSAGES."""
    path = context.bag_location.path if context.bag_location is not None else None
    if path is None:
        # Several bags are not read; a rendered one is counted without reading.
        return MessageCount(_MIN_ESTIMATED_MESSAGES, exact=False)
    try:
        messages = islice(_messages_in_window(context, path, {topic}), _MIN_ESTIMATED_MESSAGES)
        counted = sum(1 for _ in messages)
    except DataError:
        # Other rules report unreadable bags and windows outside of the bag.
        return MessageCount(_MIN_ESTIMATED_MESSAGES, exact=False)
    return MessageCount(counted, exact=counted < _MIN_ESTIMATED_MESSAGES)


def window_stamps(context: Context, topics: set[str]) -> dict[str, list[int]] | None:
    """The header stamps in the window by bag topic; None if they are not read."""
    from r2bspec.ipc.buffers import STAMP_BYTES, read_stamp

    path = context.bag_location.path if context.bag_location is not None else None
    if context.bag is None or path is None or _size(path) > MAX_STAMPS_BYTES:
        return None
    by_name = {topic.lstrip("/"): topic for topic in topics}
    stamps: dict[str, list[int]] = {topic: [] for topic in topics}
    try:
        for message in _messages_in_window(context, path, topics):
            if len(message.data) < STAMP_BYTES:
                return None
            stamps[by_name[message.topic.lstrip("/")]].append(read_stamp(message.data))
    except DataError:
        # Other rules report bags and windows that cannot be read.
        return None
    return stamps


def _messages_in_window(context: Context, bag: Path, topics: set[str]) -> Iterator[RecordedMessage]:
    from r2bspec.bags.bag_reader import read_messages

    window = context.spec.data_loader.window
    end_ns = window.end.ns if window.end else None
    return read_messages(bag, topics, TimeWindow(start_ns=window.start.ns, end_ns=end_ns))


def _size(path: Path) -> int:
    try:
        files = [file for file in path.iterdir() if file.is_file()] if path.is_dir() else [path]
        return sum(file.stat().st_size for file in files)
    except OSError:
        return MAX_STAMPS_BYTES + 1
