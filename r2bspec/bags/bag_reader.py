"""Reading the messages of a bag in order of time, as published bytes."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path

from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.metadata import FileSpan, read_metadata
from r2bspec.bags.recording import (
    BagIndex,
    DataError,
    RecordedMessage,
    Selection,
    TimeWindow,
    not_cdr,
    topic_not_found,
)
from r2bspec.bags.storage.storage import (
    PACKED,
    Storage,
    open_storages,
    storage_errors,
    storage_paths,
)


def read_messages(
    path: Path, topics: Collection[str], window: TimeWindow | None = None
) -> Iterator[RecordedMessage]:
    """Yield the messages of the named topics in time order; equal times in stored order.

    Memory is bounded by a few messages (sqlite3) or chunks (MCAP). Only the named topics are read:
    others may have any type or serialization. The arguments are checked immediately, before the
    first message is requested.

    Args:
        path: bag folder or storage file.
        topics: names as in the index; a leading slash is optional.
        window: relative to the index's `start_ns`; None for everything.

    Raises:
        DataError: as `index_bag`; a topic does not exist (R2B308) or is not CDR (R2B306); the
            window is outside of the bag (R2B309); while iterating, damaged storage (R2B304), also
            if a completely read bag has fewer messages than it states.
    """
    index = index_bag(path)
    names = _resolve_topics(path, index, topics)
    _check_window(path, index, window)
    return _read(path, index, names, window)


def _resolve_topics(path: Path, index: BagIndex, topics: Collection[str]) -> frozenset[str]:
    """Return the recorded names of topics that can be read.

    Raises:
        DataError: R2B306 or R2B308.
    """
    names = set()
    for topic in topics:
        info = index.find(topic)
        if info is None:
            raise topic_not_found(str(path), topic, index.topics)
        if info.serialization != "cdr":
            raise not_cdr(str(path), info)
        names.add(info.name)
    return frozenset(names)


def _check_window(path: Path, index: BagIndex, window: TimeWindow | None) -> None:
    """Check that a window is not empty and does not begin after the last message.

    Raises:
        DataError: R2B309.
    """
    if window is None:
        return
    if window.start_ns < 0 or (window.end_ns is not None and window.end_ns <= window.start_ns):
        raise DataError(
            f"the window from {window.start_ns / 1e9:g} s to {(window.end_ns or 0) / 1e9:g} s of"
            f" {path} is empty",
            code="R2B309",
            hint="its end must come after its start, and its start not before 0 s",
        )
    if index.message_count and window.start_ns > index.duration_ns:
        raise DataError(
            f"the window begins at {window.start_ns / 1e9:g} s, but {path} ends after"
            f" {index.duration_ns / 1e9:g} s",
            code="R2B309",
            hint="windows are relative to the start of the bag",
        )


def _read(
    path: Path, index: BagIndex, names: frozenset[str], window: TimeWindow | None
) -> Iterator[RecordedMessage]:
    if not names or not index.message_count:
        return
    selection = Selection(names=names)
    if window is not None:
        stop_ns = None if window.end_ns is None else index.start_ns + window.end_ns
        start_ns = index.start_ns + window.start_ns
        selection = Selection(names=names, start_ns=start_ns, stop_ns=stop_ns)
    # The number of messages is known for a complete bag, but not for a window.
    missing = Counter({name: index.topics[name].count for name in names} if window is None else ())
    last_ns = index.start_ns
    for message in _read_files(path, index, selection):
        if not last_ns <= message.time_ns <= index.end_ns:
            raise DataError(
                f"{path} has a message of {message.time_ns} ns after one of {last_ns} ns, in a"
                f" recording that ends at {index.end_ns} ns",
                code="R2B304",
                hint="its index is damaged; copy or record the bag again",
            )
        last_ns = message.time_ns
        missing[message.topic] -= 1
        yield message
    wrong = [
        f"{name}: {index.topics[name].count - count:,} of {index.topics[name].count:,}"
        for name, count in sorted(missing.items())
        if count and window is None
    ]
    if wrong:
        raise DataError(
            f"{path} does not have the stated numbers of messages: {'; '.join(wrong)}",
            code="R2B304",
            hint="the bag is damaged or incomplete; copy or record it again",
        )


def _read_files(path: Path, index: BagIndex, selection: Selection) -> Iterator[RecordedMessage]:
    files = storage_paths(path, index.files)
    if index.compression == "file":
        # Unpacking takes time and space: what is outside of the window stays packed.
        spans = {span.name.removesuffix(PACKED): span for span in read_metadata(path).spans}
        files = tuple(
            file
            for file in files
            if _is_in_window(spans.get(file.name.removesuffix(PACKED)), selection)
        )
    with open_storages(files) as storages:
        streams = [
            _read_file(file, storage, selection)
            for file, storage in zip(files, storages, strict=True)
        ]
        # The files of a split recording may overlap, because the recorder buffers messages.
        yield from heapq.merge(*streams, key=lambda message: message.time_ns)


def _is_in_window(span: FileSpan | None, selection: Selection) -> bool:
    if span is None:
        return True
    return (selection.start_ns is None or span.end_ns >= selection.start_ns) and (
        selection.stop_ns is None or span.start_ns < selection.stop_ns
    )


def _read_file(file: Path, storage: Storage, selection: Selection) -> Iterator[RecordedMessage]:
    with storage_errors(file):
        yield from storage.messages(selection)
