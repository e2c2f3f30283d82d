"""The index of a bag, from its metadata, checked against its storage."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, cast

import msgspec

from r2bspec.bags import recording
from r2bspec.bags.metadata import BagMetadata, read_metadata
from r2bspec.bags.storage.storage import Storage, open_storages, storage_errors, storage_paths


class _StorageSummary(msgspec.Struct):
    """The content of all storage files, summed up."""

    topics: dict[str, recording.TopicInfo]
    start_ns: int
    end_ns: int
    notes: list[str]


def index_bag(path: Path) -> recording.BagIndex:
    """Index a bag folder, or a lone storage file, without message bodies.

    If metadata and storage differ in topics, types or counts, this is an error; if they differ in
    times, which some recorders write wrongly, the storage is used, with a note. For bags whose
    files are compressed as a whole, only the metadata is used.

    Raises:
        DataError: R2B301 to R2B305, R2B310 and R2B313, each with a hint.
    """
    # Unlike those of pathlib, these return False for a name that is too long.
    if os.path.isdir(path):  # noqa: PTH112
        return _index_folder(path)
    if not os.path.exists(path):  # noqa: PTH110
        raise recording.DataError(
            f"{path} does not exist",
            code="R2B301",
            hint=f"give a bag folder, a {recording.SUFFIXES_TEXT} file, or a dataset",
        )
    bag_format = recording.format_of_suffix(path.suffix)
    if bag_format is None:
        raise recording.DataError(
            f"{path} is neither a bag folder nor a {recording.SUFFIXES_TEXT} file",
            code="R2B304",
            hint="give the folder that contains metadata.yaml"
            + (", or unpack the file with 'zstd -d'" if path.suffix in {".zstd", ".zst"} else ""),
        )
    return _index_file(path, bag_format)


def _index_folder(path: Path) -> recording.BagIndex:
    metadata = read_metadata(path)
    spans_ns: dict[str, tuple[int, int] | None] = {}
    storage = _storage_name(path, metadata)
    paths = storage_paths(path, metadata.files)
    compression = _compression(path, metadata)
    if compression == "file":
        start_ns, end_ns = metadata.start_ns, metadata.start_ns + metadata.duration_ns
        notes: tuple[str, ...] = ("files are compressed: metadata.yaml was not checked",)
    else:
        with open_storages(paths, compressed_files=False) as storages:
            summary = _summarize(paths, storages)
        _check_metadata(path, metadata, summary)
        start_ns, end_ns = summary.start_ns, summary.end_ns
        spans_ns = {name: topic.span_ns for name, topic in summary.topics.items()}
        notes = (*_time_notes(metadata, summary), *summary.notes)
    if metadata.message_count == 0:
        start_ns = end_ns = 0
    index = recording.BagIndex(
        name=path.resolve().name,
        storage=storage,
        topics=recording.merge_topics(
            (recording.with_span(topic, spans_ns.get(topic.name)) for topic in metadata.topics),
            end_ns - start_ns,
        ),
        start_ns=start_ns,
        end_ns=end_ns,
        message_count=metadata.message_count,
        files=metadata.files,
        compression=compression,
        notes=notes,
    )
    record = recording.read_provenance(path)
    return index if record is None else record.complete_index(index)


def _index_file(path: Path, bag_format: recording.BagFormat) -> recording.BagIndex:
    paths = storage_paths(path, ())
    with open_storages(paths, compressed_files=False) as storages:
        summary = _summarize(paths, storages)
    return recording.BagIndex(
        name=path.name,
        storage=bag_format.name,
        topics=summary.topics,
        start_ns=summary.start_ns,
        end_ns=summary.end_ns,
        message_count=sum(topic.count for topic in summary.topics.values()),
        files=(path.name,),
        notes=(*([bag_format.note] if bag_format.note else []), *summary.notes),
    )


def _storage_name(path: Path, metadata: BagMetadata) -> str:
    known = sorted(bag_format.name for bag_format in recording.BAG_FORMATS if bag_format.folders)
    if metadata.storage not in known:
        raise recording.DataError(
            f"{path} has the storage format {metadata.storage!r}; supported are "
            f"{' and '.join(known)}",
            code="R2B302",
            hint="convert it with 'ros2 bag convert'",
        )
    return metadata.storage


def _compression(path: Path, metadata: BagMetadata) -> Literal["none", "message", "file"]:
    mode = metadata.compression_mode or "none"
    if mode not in {"none", "message", "file"} or (
        mode != "none" and metadata.compression_format != "zstd"
    ):
        raise recording.DataError(
            f"{path} is compressed with {metadata.compression_format!r} by {mode!r};"
            " supported is zstd by message or by file",
            code="R2B302",
            hint="convert it with 'ros2 bag convert'",
        )
    return cast("Literal['none', 'message', 'file']", mode)


def _summarize(paths: Sequence[Path], storages: Sequence[Storage]) -> _StorageSummary:
    """Sum topics, counts and extents over storage files."""
    filled = [storage for storage in storages if storage.message_count]
    start_ns = min((storage.start_ns for storage in filled), default=0)
    end_ns = max((storage.end_ns for storage in filled), default=0)
    entries: list[recording.TopicInfo] = []
    for path, storage in zip(paths, storages, strict=True):
        with storage_errors(path):
            entries += storage.timed_topics()
    topics = recording.merge_topics(entries, end_ns - start_ns)
    notes = [
        f"{entry.name} was recorded as {topics[entry.name].type} and as {entry.type}"
        for entry in entries
        if entry.type != topics[entry.name].type
    ]
    return _StorageSummary(topics, start_ns, end_ns, notes)


def _check_metadata(path: Path, metadata: BagMetadata, summary: _StorageSummary) -> None:
    """Raise DataError if the metadata differs from the content of the storage."""
    stated = Counter(
        {name: topic.count for name, topic in recording.merge_topics(metadata.topics, 0).items()}
    )
    stored = Counter({name: topic.count for name, topic in summary.topics.items()})
    wrong = [
        f"{name}: {stated[name]:,} stated, {stored[name]:,} stored"
        for name in sorted(stated.keys() | stored.keys())
        if stated[name] != stored[name]
    ]
    wrong += [
        f"{topic.name}: {topic.type} stated, {summary.topics[topic.name].type} stored"
        for topic in metadata.topics
        if topic.name in summary.topics and summary.topics[topic.name].type != topic.type
    ]
    if stated.total() != metadata.message_count:
        wrong.append(f"total: {metadata.message_count:,} stated, {stated.total():,} by topic")
    if wrong:
        shown = "; ".join(wrong[:3]) + (f"; and {len(wrong) - 3} more" if len(wrong) > 3 else "")
        raise recording.DataError(
            f"{path / 'metadata.yaml'} does not match the storage: {shown}",
            code="R2B310",
            hint=f"if the recording was interrupted, run 'ros2 bag reindex {path}'",
        )


def _time_notes(metadata: BagMetadata, summary: _StorageSummary) -> list[str]:
    if not metadata.message_count:
        return []
    stated = (metadata.start_ns, metadata.start_ns + metadata.duration_ns)
    if stated == (summary.start_ns, summary.end_ns):
        return []
    stored = f"the storage has {summary.start_ns} to {summary.end_ns} ns"
    return [f"metadata.yaml states {stated[0]} to {stated[1]} ns, {stored}"]
