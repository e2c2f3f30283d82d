"""The integrity of a bag: hashes of its files and of its content, and its verification.

A bag on disk is verified against its metadata and its provenance.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from r2bspec.bags import recording
from r2bspec.bags.bag_index import index_bag, unnamed_files
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.storage.storage import storage_errors, storage_paths
from r2bspec.safe_io.file_search import regular_files
from r2bspec.safe_io.safe_file import open_regular

_BLOCK_BYTES = 1 << 20


class ContentHash:
    """SHA-256 over topics, types, relative times and uncompressed CDR.

    Each topic is hashed separately and the digests are combined in order of names, so that the
    order of messages with equal times does not matter. Numbers are 8 bytes, little-endian; strings
    and messages are preceded by their lengths, so that the encoding is unambiguous.
    """

    def __init__(self, types: dict[str, str], start_ns: int) -> None:
        self._start_ns = start_ns
        self._topics = {name: hashlib.sha256() for name in sorted(types)}
        for name, kind in types.items():
            for text in (name, kind):
                encoded = text.encode()
                self._topics[name].update(_encode_int(len(encoded)) + encoded)

    def add(self, message: recording.RecordedMessage) -> None:
        """Add a message; the messages of a topic must be in order of time."""
        topic = self._topics[message.topic]
        topic.update(_encode_int(message.time_ns - self._start_ns) + _encode_int(len(message.data)))
        topic.update(message.data)

    def hexdigest(self) -> str:
        """Return the hash of everything added, 64 hexadecimal digits."""
        whole = hashlib.sha256()
        for topic in self._topics.values():
            whole.update(topic.digest())
        return whole.hexdigest()


def hash_files(path: Path) -> str:
    """Return the SHA-256 over the names, sizes and bytes of all files of a bag, streamed.

    Raises:
        DataError: the bag does not exist (R2B301) or a file cannot be read (R2B304).
    """
    paths = sorted(regular_files(path)) if path.is_dir() else storage_paths(path, ())
    whole = hashlib.sha256()
    for root in paths:
        name = root.relative_to(path if path.is_dir() else path.parent).as_posix().encode()
        with storage_errors(root), open_regular(root) as stream:
            whole.update(_encode_int(len(name)) + name + _encode_int(root.stat().st_size))
            while block := stream.read(_BLOCK_BYTES):
                whole.update(block)
    return whole.hexdigest()


def _encode_int(value: int) -> bytes:
    # A damaged bag may state times of any size; their lowest 64 bits tell them apart, too.
    return (value & (1 << 64) - 1).to_bytes(8, "little")


def hash_content(path: Path) -> str:
    """Hash the content of a bag: independent of storage format, compression, splitting and date.

    Raises:
        DataError: as `read_messages`.
    """
    return _read(path, index_bag(path))[0]


def verify(path: Path) -> list[str]:
    """Read a complete bag and list its problems, one sentence each.

    Every message must be readable, and the counts must match the metadata. For a synthetic
    dataset, the content hash, the counts and the file sizes must also match its record.

    Returns:
        The problems; empty if there are none. An unreadable bag is a problem, not an exception.
    """
    try:
        index = index_bag(path)
        content, counts = _read(path, index)
    except recording.DataError as error:
        return [f"{error} ({error.code}): {error.hint}"]
    problems = [
        f"{name}: {info.count:,} messages in the metadata, {counts[name]:,} readable"
        for name, info in index.topics.items()
        if info.serialization == "cdr" and counts[name] != info.count
    ]
    problems += [
        f"{name} is no part of the bag: metadata.yaml does not name it"
        for name in unnamed_files(path, index)
    ]
    record = recording.read_provenance(path)
    if record is not None:
        problems += _record_mismatches(path, index, record, content)
    elif (path / recording.RECORD_NAME).exists():
        problems.append(f"{recording.RECORD_NAME} was not written by 'r2bspec data make'")
    return problems


def _read(path: Path, index: recording.BagIndex) -> tuple[str, Counter[str]]:
    """Content hash and counts of all topics that can be read."""
    readable = {
        name: info.type for name, info in index.topics.items() if info.serialization == "cdr"
    }
    content = ContentHash(readable, index.start_ns)
    counts: Counter[str] = Counter()
    for message in read_messages(path, readable):
        content.add(message)
        counts[message.topic] += 1
    return content.hexdigest(), counts


def _record_mismatches(
    path: Path, index: recording.BagIndex, record: recording.DatasetRecord, content: str
) -> Iterator[str]:
    if content != record.content_sha256:
        recorded = f"{record.content_sha256} in {recording.RECORD_NAME}"
        yield f"the content hash is {content}, but {recorded}"
    for name in sorted(record.topics.keys() | index.topics.keys()):
        expected = record.topics[name].count if name in record.topics else 0
        actual = index.topics[name].count if name in index.topics else 0
        if expected != actual:
            yield f"{name}: {expected:,} messages in {recording.RECORD_NAME}, {actual:,} in the bag"
    for name, size_bytes in record.file_bytes.items():
        file = path / name
        actual = file.stat().st_size if file.is_file() else 0
        if actual != size_bytes:
            yield f"{name} has {actual:,} bytes, but {size_bytes:,} in {recording.RECORD_NAME}"
