"""Verifying a bag on disk against its metadata and its provenance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.dataset_record import RECORD_NAME, DatasetRecord, read_provenance
from r2bspec.bags.digest import ContentHash
from r2bspec.bags.errors import DataError
from r2bspec.bags.recording import BagIndex


def verify(path: Path) -> list[str]:
    """Read a complete bag and list its problems, one sentence each.

    Every message must be readable, and the counts must match the metadata. For a synthetic
    dataset, the content hash, the counts and the file sizes must also match its record.

    Returns:
        The problems; empty if there are none. An unreadable bag is a problem, not an exception.
    """
    path = Path(path)
    try:
        index = index_bag(path)
        content, counts = _read(path, index)
    except DataError as error:
        return [f"{error} ({error.code}): {error.hint}"]
    problems = [
        f"{name}: {info.count:,} messages in the metadata, {counts[name]:,} readable"
        for name, info in index.topics.items()
        if info.serialization == "cdr" and counts[name] != info.count
    ]
    record = read_provenance(path)
    if record is not None:
        problems += _record_mismatches(path, index, record, content)
    elif (path / RECORD_NAME).exists():
        problems.append(f"{RECORD_NAME} was not written by 'r2bspec data make'")
    return problems


def _read(path: Path, index: BagIndex) -> tuple[str, Counter[str]]:
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
    path: Path, index: BagIndex, record: DatasetRecord, content: str
) -> Iterator[str]:
    if content != record.content_sha256:
        yield f"the content hash is {content}, but {record.content_sha256} in {RECORD_NAME}"
    for name in sorted(record.topics.keys() | index.topics.keys()):
        expected = record.topics[name].count if name in record.topics else 0
        actual = index.topics[name].count if name in index.topics else 0
        if expected != actual:
            yield f"{name}: {expected:,} messages in {RECORD_NAME}, {actual:,} in the bag"
    for name, size_bytes in record.file_bytes.items():
        file = path / name
        actual = file.stat().st_size if file.is_file() else 0
        if actual != size_bytes:
            yield f"{name} has {actual:,} bytes, but {size_bytes:,} in {RECORD_NAME}"
