"""The index of a bag, from its metadata, checked against its storage."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import Literal, cast

import msgspec

from r2bspec.bags.metadata import (
    BagMetadata,
    TopicMetadata,
    read_metadata,
)
from r2bspec.bags.recording import (
    BAG_NOT_FOUND,
    METADATA_DISAGREES,
    METADATA_UNREADABLE,
    STORAGE_UNREADABLE,
    SUFFIXES_TEXT,
    BagFormat,
    BagIndex,
    DataError,
    TopicInfo,
    folder_format_names,
    format_of_suffix,
    read_provenance,
)
from r2bspec.bags.storage.storage import Storage, open_storages, storage_paths


class _StorageSummary(msgspec.Struct):
    """The content of all storage files, summed up."""

    types: dict[str, str]
    serializations: dict[str, str]
    counts: Counter[str]
    start_ns: int
    end_ns: int
    notes: list[str]


def index_bag(path: Path) -> BagIndex:
    """Index a bag folder, or a lone storage file, without message bodies.

    If metadata and storage differ in topics, types or counts, this is an error; if they differ in
    times, which some recorders write wrongly, the storage is used, with a note. For bags whose
    files are compressed as a whole, only the metadata is used.

    Raises:
        DataError: R2B301 to R2B305, R2B310 and R2B313, each with a hint.
    """
    path = Path(path)
    # Unlike those of pathlib, these return False for a name that is too long.
    if os.path.isdir(path):  # noqa: PTH112
        return _index_folder(path)
    if not os.path.exists(path):  # noqa: PTH110
        raise DataError(
            f"{path} does not exist",
            code=BAG_NOT_FOUND,
            hint=f"give a bag folder, a {SUFFIXES_TEXT} file, or a dataset",
        )
    bag_format = format_of_suffix(path.suffix)
    if bag_format is None:
        raise DataError(
            f"{path} is neither a bag folder nor a {SUFFIXES_TEXT} file",
            code=STORAGE_UNREADABLE,
            hint=_unsupported_hint(path),
        )
    return _index_file(path, bag_format)


def _unsupported_hint(path: Path) -> str:
    if path.suffix in {".zstd", ".zst"}:
        return "give the folder that contains metadata.yaml, or unpack the file with 'zstd -d'"
    return "give the folder that contains metadata.yaml"


def _index_folder(path: Path) -> BagIndex:
    metadata = read_metadata(path)
    storage = _storage_name(path, metadata)
    paths = storage_paths(path, metadata.files)
    compression = _compression(path, metadata)
    if compression == "file":
        start_ns, end_ns = metadata.start_ns, metadata.start_ns + metadata.duration_ns
        notes: tuple[str, ...] = ("files are compressed: metadata.yaml was not checked",)
    else:
        with open_storages(paths, compressed_files=False) as storages:
            summary = _summarize(storages)
        _check_metadata(path, metadata, summary)
        start_ns, end_ns = summary.start_ns, summary.end_ns
        notes = (*_time_notes(metadata, summary), *summary.notes)
    if metadata.message_count == 0:
        start_ns = end_ns = 0
    index = BagIndex(
        name=path.resolve().name,
        storage=storage,
        topics=_topics(metadata.topics, end_ns - start_ns),
        start_ns=start_ns,
        end_ns=end_ns,
        message_count=metadata.message_count,
        files=metadata.files,
        compression=compression,
        notes=notes,
    )
    record = read_provenance(path)
    return index if record is None else record.complete_index(index)


def _index_file(path: Path, bag_format: BagFormat) -> BagIndex:
    paths = storage_paths(path, ())
    with open_storages(paths, compressed_files=False) as storages:
        summary = _summarize(storages)
    topics = tuple(
        TopicMetadata(
            name=name,
            type=summary.types[name],
            serialization=summary.serializations[name],
            qos="",
            count=count,
        )
        for name, count in summary.counts.items()
    )
    return BagIndex(
        name=path.name,
        storage=bag_format.name,
        topics=_topics(topics, summary.end_ns - summary.start_ns),
        start_ns=summary.start_ns,
        end_ns=summary.end_ns,
        message_count=summary.counts.total(),
        files=(path.name,),
        notes=(*([bag_format.note] if bag_format.note else []), *summary.notes),
    )


def _storage_name(path: Path, metadata: BagMetadata) -> str:
    known = folder_format_names()
    if metadata.storage not in known:
        raise DataError(
            f"{path} has the storage format {metadata.storage!r}; supported are "
            f"{' and '.join(known)}",
            code=METADATA_UNREADABLE,
            hint="convert it with 'ros2 bag convert'",
        )
    return metadata.storage


def _compression(path: Path, metadata: BagMetadata) -> Literal["none", "message", "file"]:
    mode = metadata.compression_mode or "none"
    if mode not in {"none", "message", "file"} or (
        mode != "none" and metadata.compression_format != "zstd"
    ):
        raise DataError(
            f"{path} is compressed with {metadata.compression_format!r} by {mode!r};"
            " supported is zstd by message or by file",
            code=METADATA_UNREADABLE,
            hint="convert it with 'ros2 bag convert'",
        )
    return cast("Literal['none', 'message', 'file']", mode)


def _summarize(storages: list[Storage]) -> _StorageSummary:
    """Sum topics, counts and extents over storage files."""
    summary = _StorageSummary({}, {}, Counter(), 0, 0, [])
    filled = [each for each in storages if each.message_count]
    if filled:
        summary.start_ns = min(each.start_ns for each in filled)
        summary.end_ns = max(each.end_ns for each in filled)
    for storage in storages:
        for topic in storage.topics:
            known = summary.types.setdefault(topic.name, topic.type)
            if known != topic.type:
                summary.notes.append(f"{topic.name} was recorded as {known} and as {topic.type}")
            summary.serializations.setdefault(topic.name, topic.serialization)
            summary.counts[topic.name] += topic.count
    return summary


def _check_metadata(path: Path, metadata: BagMetadata, summary: _StorageSummary) -> None:
    """Raise DataError if the metadata differs from the content of the storage."""
    stated = Counter({topic.name: 0 for topic in metadata.topics})
    for topic in metadata.topics:
        stated[topic.name] += topic.count
    wrong = [
        f"{name}: {stated[name]:,} stated, {summary.counts[name]:,} stored"
        for name in sorted(stated.keys() | summary.counts.keys())
        if stated[name] != summary.counts[name]
    ]
    wrong += [
        f"{topic.name}: {topic.type} stated, {summary.types[topic.name]} stored"
        for topic in metadata.topics
        if summary.types.get(topic.name, topic.type) != topic.type
    ]
    if stated.total() != metadata.message_count:
        wrong.append(f"total: {metadata.message_count:,} stated, {stated.total():,} by topic")
    if wrong:
        shown = "; ".join(wrong[:3]) + (f"; and {len(wrong) - 3} more" if len(wrong) > 3 else "")
        raise DataError(
            f"{path / 'metadata.yaml'} does not match the storage: {shown}",
            code=METADATA_DISAGREES,
            hint=f"if the recording was interrupted, run 'ros2 bag reindex {path}'",
        )


def _time_notes(metadata: BagMetadata, summary: _StorageSummary) -> list[str]:
    if not metadata.message_count:
        return []
    stated = (metadata.start_ns, metadata.start_ns + metadata.duration_ns)
    if stated == (summary.start_ns, summary.end_ns):
        return []
    note = (
        f"metadata.yaml states {stated[0]} to {stated[1]} ns, the storage has"
        f" {summary.start_ns} to {summary.end_ns} ns"
    )
    return [note]


def _topics(topics: tuple[TopicMetadata, ...], duration_ns: int) -> dict[str, TopicInfo]:
    """Merge the entries of a topic that was recorded from several publishers, and sort."""
    merged: dict[str, TopicInfo] = {}
    for topic in sorted(topics, key=lambda topic: topic.name):
        before = merged.get(topic.name)
        count = topic.count + (before.count if before else 0)
        merged[topic.name] = TopicInfo(
            name=topic.name,
            type=before.type if before else topic.type,
            count=count,
            rate_hz=(count - 1) * 1e9 / duration_ns if count > 1 and duration_ns > 0 else 0.0,
            serialization=topic.serialization,
            qos=before.qos if before else topic.qos,
        )
    return merged
