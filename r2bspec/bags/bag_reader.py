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
    topic_not_found,
)
from r2bspec.bags.storage.storage import Storage, open_storages, storage_errors, storage_paths


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
    """The recorded names of topics that can be read.

    Raises:
        DataError: R2B306 or R2B308.
    """
    names = set()
    for topic in topics:
        info = index.find(topic)
        if info is None:
            raise topic_not_found(str(path), topic, index.topics)
        if info.serialization != "cdr":
            raise DataError(
                f"{path} has {info.name} serialised as {info.serialization!r}; only 'cdr' is"
                " supported",
                code="R2B306",
                hint="convert the bag with 'ros2 bag convert' on a machine with this format",
            )
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
    for message in _read_groups(path, index, selection):
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


def _read_groups(path: Path, index: BagIndex, selection: Selection) -> Iterator[RecordedMessage]:
    packed = index.compression == "file"
    paths = storage_paths(path, index.files)
    # Unpacked files take space, so only those needed at the same time are unpacked together.
    spans = {span.name: span for span in read_metadata(path).spans} if packed else {}
    for group in _overlapping_groups(paths, spans, selection):
        with open_storages(group, compressed_files=packed) as storages:
            for file, storage in zip(group, storages, strict=True):
                _check_span(file, storage, spans.get(file.name))
            streams = [
                _read_file(file, storage, selection)
                for file, storage in zip(group, storages, strict=True)
                if storage.message_count
            ]
            # The files of a split recording may overlap, because the recorder buffers messages.
            yield from (
                streams[0]
                if len(streams) == 1
                else heapq.merge(*streams, key=lambda message: message.time_ns)
            )


def _overlapping_groups(
    paths: tuple[Path, ...], spans: dict[str, FileSpan], selection: Selection
) -> Iterator[tuple[Path, ...]]:
    """The files to read, grouped by overlapping times, without files outside of the window.

    If the times of a file are unknown, all of them are one group.
    """
    by_name = {path.name: path for path in paths}
    if not spans or not spans.keys() <= by_name.keys():
        yield paths
        return
    group: list[Path] = []
    until_ns = 0
    for span in sorted(spans.values(), key=lambda span: span.start_ns):
        if selection.start_ns is not None and span.end_ns < selection.start_ns:
            continue
        if selection.stop_ns is not None and span.start_ns >= selection.stop_ns:
            continue
        if group and span.start_ns > until_ns:
            yield tuple(group)
            group, until_ns = [], 0
        group.append(by_name[span.name])
        until_ns = max(until_ns, span.end_ns)
    if group:
        yield tuple(group)


def _check_span(file: Path, storage: Storage, span: FileSpan | None) -> None:
    """Check that the times of a file are those in the metadata.

    Raises:
        DataError: R2B310.
    """
    if span is None or not storage.message_count:
        return
    if storage.start_ns < span.start_ns or storage.end_ns > span.end_ns:
        raise DataError(
            f"{file} has {storage.start_ns} to {storage.end_ns} ns, metadata.yaml states"
            f" {span.start_ns} to {span.end_ns} ns",
            code="R2B310",
            hint=f"unpack the file, and run 'ros2 bag reindex {file.parent}'",
        )


def _read_file(file: Path, storage: Storage, selection: Selection) -> Iterator[RecordedMessage]:
    types: dict[str, str] = {}
    for topic in storage.topics:
        if topic.name in selection.names and types.setdefault(topic.name, topic.type) != topic.type:
            raise DataError(
                f"{file} has {topic.name} as {types[topic.name]} and as {topic.type}",
                code="R2B304",
                hint="a topic can be played with one type only",
            )
    if types:
        with storage_errors(file):
            yield from storage.messages(selection)
