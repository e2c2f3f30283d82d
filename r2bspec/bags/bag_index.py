"""The index of a bag, from its storage, compared with its metadata."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, cast

from msgspec.structs import replace

from r2bspec.bags import recording
from r2bspec.bags.metadata import METADATA_NAME, BagMetadata, read_metadata, storage_of
from r2bspec.bags.storage.storage import (
    PACKED,
    is_packed,
    open_storages,
    other_files_hint,
    storage_errors,
    storage_files,
    storage_paths,
)


def index_bag(path: Path) -> recording.BagIndex:
    """Index a bag folder, or a single storage file, without message bodies.

    If metadata and storage differ in topics, types or counts, this is an error; times are those of
    the storage, because some recorders write wrong ones. For bags whose files are compressed as a
    whole, only the metadata is used.

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
    if not storage_of([path.name]):
        raise recording.DataError(
            f"{path} is neither a bag folder nor a {recording.SUFFIXES_TEXT} file",
            code="R2B304",
            hint="convert the bag of ROS 1 with 'rosbags-convert'"
            if path.suffix == ".bag"
            else "give the folder that contains metadata.yaml",
        )
    return _index(path, _stored_topics(storage_paths(path, ())), (path.name,))


def _index_folder(path: Path) -> recording.BagIndex:
    files = _files_without_metadata(path)
    if files:
        return _index(path.resolve(), _stored_topics(storage_paths(path, files)), files)
    metadata = read_metadata(path)
    there = storage_files(path)
    if there and not metadata.files:
        raise recording.DataError(
            f"{path / METADATA_NAME} names no storage file",
            code="R2B303",
            hint=other_files_hint(path, there),
        )
    if metadata.storage not in recording.SUFFIXES:
        raise recording.DataError(
            f"{path} has the storage format {metadata.storage!r}; supported are "
            f"{' and '.join(recording.SUFFIXES)}",
            code="R2B302",
            hint="convert it with 'ros2 bag convert'",
        )
    paths = storage_paths(path, metadata.files)
    compression = _compression(path, metadata, paths)
    if compression == "file":
        topics: Sequence[recording.TopicInfo] = metadata.topics
    else:
        profiles = {topic.name: topic.qos for topic in metadata.topics}
        topics = [
            replace(topic, qos=profiles.get(topic.name) or topic.qos)
            for topic in _stored_topics(paths)
        ]
        _check_metadata(path, metadata, topics)
    names = tuple(file.relative_to(path).as_posix() for file in paths)
    index = replace(
        _index(path.resolve(), topics, names), storage=metadata.storage, compression=compression
    )
    if compression == "file" and index.message_count:
        end_ns = metadata.start_ns + metadata.duration_ns
        index = replace(
            index,
            start_ns=metadata.start_ns,
            end_ns=end_ns,
            topics=recording.merge_topics(topics, metadata.duration_ns),
        )
    record = recording.read_provenance(path)
    return index if record is None else record.complete_index(index)


def _files_without_metadata(path: Path) -> tuple[str, ...]:
    """Return the storage files of a recorder that was killed before it wrote metadata.yaml."""
    if (path / METADATA_NAME).exists() or (path / recording.RECORD_NAME).exists():
        return ()
    return storage_files(path)


def unnamed_files(path: Path, index: recording.BagIndex) -> tuple[str, ...]:
    """Return the storage files in the folder of a bag that do not belong to it."""
    if not path.is_dir():
        return ()
    named = {name.removesuffix(PACKED) for name in index.files}
    return tuple(name for name in storage_files(path) if name.removesuffix(PACKED) not in named)


def _index(
    path: Path, topics: Sequence[recording.TopicInfo], files: tuple[str, ...]
) -> recording.BagIndex:
    spans_ns = [span for topic in topics if (span := topic.span_ns) is not None]
    start_ns = min((first_ns for first_ns, _ in spans_ns), default=0)
    end_ns = max((last_ns for _, last_ns in spans_ns), default=0)
    return recording.BagIndex(
        name=path.name,
        storage=storage_of(files),
        topics=recording.merge_topics(topics, end_ns - start_ns),
        start_ns=start_ns,
        end_ns=end_ns,
        message_count=sum(topic.count for topic in topics),
        files=files,
    )


def _stored_topics(paths: tuple[Path, ...]) -> list[recording.TopicInfo]:
    """Return the topics of all storage files, one for each recorded publisher.

    Raises:
        DataError: R2B304 or R2B313.
    """
    topics: list[recording.TopicInfo] = []
    with open_storages(paths) as storages:
        for path, storage in zip(paths, storages, strict=True):
            with storage_errors(path):
                topics += storage.index()
    return topics


def _compression(
    path: Path, metadata: BagMetadata, paths: tuple[Path, ...]
) -> Literal["none", "message", "file"]:
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
    for file in paths:
        with storage_errors(file):
            if is_packed(file):
                return "file"
    return cast("Literal['none', 'message']", "none" if mode == "file" else mode)


def _check_metadata(
    path: Path, metadata: BagMetadata, topics: Sequence[recording.TopicInfo]
) -> None:
    """Raise DataError if the metadata has other topics or counts than the storage."""
    stated, stored = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    for counts, counted in ((stated, metadata.topics), (stored, topics)):
        for topic in counted:
            counts[topic.name, topic.type] += topic.count
    wrong = [
        f"{name}: {stated[name, kind]:,} stated, {stored[name, kind]:,} stored as {kind}"
        for name, kind in sorted(stated.keys() | stored.keys())
        if stated[name, kind] != stored[name, kind]
    ]
    if wrong:
        shown = "; ".join(wrong[:3]) + (f"; and {len(wrong) - 3} more" if len(wrong) > 3 else "")
        raise recording.DataError(
            f"{path / 'metadata.yaml'} does not match the storage: {shown}",
            code="R2B310",
            hint=f"if the recording was interrupted, run 'ros2 bag reindex {path}'",
        )
