"""Merging the indexes of several recordings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from r2bspec.bags.recording import BagIndex, TopicInfo


def merge_indexes(indexes: Sequence[BagIndex]) -> BagIndex | None:
    """The index of all recordings together, from the first message of any to the last of any.

    The message counts of a topic in several recordings are added; its type is that of the first.
    None without recordings.
    """
    if len(indexes) < 2:
        return indexes[0] if indexes else None
    import msgspec

    filled = [each for each in indexes if each.message_count] or list(indexes)
    start_ns = min(each.start_ns for each in filled)
    end_ns = max(each.end_ns for each in filled)
    topics: dict[str, TopicInfo] = {}
    for index in indexes:
        for name, info in index.topics.items():
            before = topics.get(name)
            topics[name] = (
                info if before is None else _merge_topic_info(before, info, end_ns - start_ns)
            )
    return msgspec.structs.replace(
        indexes[0],
        name=" + ".join(each.name for each in indexes),
        topics=dict(sorted(topics.items())),
        start_ns=start_ns,
        end_ns=end_ns,
        message_count=sum(each.message_count for each in indexes),
        files=tuple(file for each in indexes for file in each.files),
        synthetic=all(each.synthetic for each in indexes),
        notes=tuple(note for each in indexes for note in each.notes),
    )


def _merge_topic_info(one: TopicInfo, other: TopicInfo, duration_ns: int) -> TopicInfo:
    import msgspec

    count = one.count + other.count
    sizes = (one.max_message_bytes, other.max_message_bytes)
    return msgspec.structs.replace(
        one,
        count=count,
        rate_hz=(count - 1) * 1e9 / duration_ns if count > 1 and duration_ns else 0.0,
        max_message_bytes=None if None in sizes else max(size for size in sizes if size),
    )
