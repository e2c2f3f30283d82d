"""The largest message of each topic of a recorded bag, from lengths instead of bodies."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.bag_reader import check_window, read_messages, resolve_topics
from r2bspec.bags.recording import BagIndex, Window
from r2bspec.bags.storage.storage import (
    SizesReader,
    import_from_storage,
    storage_errors,
    storage_paths,
)
from r2bspec.language.bag_formats import format_named


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

    Where the storage format allows it, only lengths and first bytes are read. Other bags, and files
    that are compressed as a whole, are read, so give the window that will be read anyway.

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
    bag_format = format_named(index.storage)
    if bag_format is not None and bag_format.sizes and index.compression != "file":
        measure: SizesReader = import_from_storage(bag_format.sizes)
        first_ns, past_ns = _bounds_ns(index, window or Window())
        for file in storage_paths(path, index.files):
            with storage_errors(file):
                sizes = measure(file, largest, first_ns, past_ns)
            for name, size in sizes.items():
                largest[name] = max(largest[name], size)
    else:
        for message in read_messages(path, names, window):
            largest[message.topic] = max(largest[message.topic], len(message.data))
    return largest


def _bounds_ns(index: BagIndex, window: Window) -> tuple[int, int]:
    """The first instant of a window, and the first one after it."""
    past_ns = 2**63 - 1 if window.end_ns is None else index.start_ns + window.end_ns
    return index.start_ns + window.start_ns, past_ns
