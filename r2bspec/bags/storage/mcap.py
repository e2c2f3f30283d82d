"""MCAP storage, read by the `mcap` library in one of two ways.

Files with a complete index are read chunk by chunk. The library skips messages that are not in the
index, so a file without one, as a recorder may be told to write it, is read from start to end.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from operator import attrgetter
from pathlib import Path
from typing import BinaryIO, Literal

from mcap.reader import McapReader, NonSeekingReader, make_reader
from mcap.records import Channel, ChunkIndex, Schema
from mcap.summary import Summary

from r2bspec.bags.recording import RecordedMessage, Selection, TopicInfo
from r2bspec.bags.storage.storage import (
    EMPTY_FILE,
    DamagedStorageError,
    decompress_message,
    stored_topic,
)
from r2bspec.safe_io.safe_file import open_regular

# Opcode and length, then the channel and the bytes of the entries: a time and an offset for each.
_INDEX = struct.Struct("<BQHI")
_INDEX_RECORD = 7
_INDEX_ENTRY = struct.Struct("<QQ")
_MAGIC = b"\x89MCAP0\r\n"
_NO_SCHEMA = 0


class McapStorage:
    """An open .mcap file."""

    def __init__(self, path: Path) -> None:
        self._stream = open_regular(path)
        try:
            begins = self._stream.read(len(_MAGIC))
            if begins != _MAGIC:
                raise DamagedStorageError(
                    "it does not begin like an MCAP file" if begins else EMPTY_FILE
                )
            self._stream.seek(0)
            self._reader = make_reader(self._stream, validate_crcs=True)
            ends_at = self._stream.seek(-len(_MAGIC), 2)
            if not ends_at or self._stream.read() != _MAGIC:
                raise DamagedStorageError(
                    "it ends before its footer, as after a crash of the recorder",
                    f"'mcap recover {path.name} -o recovered.mcap' writes its readable messages to "
                    "a new file",
                )
            self._summary = _complete(self._reader.get_summary())
        except BaseException:
            self._stream.close()
            raise

    def index(self) -> tuple[TopicInfo, ...]:
        """As `Storage.index`."""
        if self._summary is None or self._summary.statistics is None:
            return self._count()
        counts = self._summary.statistics.channel_message_counts
        spans_ns = _spans_ns(self._stream, self._summary.chunk_indexes)
        return tuple(
            _topic(
                channel,
                self._summary.schemas.get(channel.schema_id),
                counts.get(number, 0),
                spans_ns.get(number),
            )
            for number, channel in self._summary.channels.items()
        )

    def messages(self, selection: Selection) -> Iterator[RecordedMessage]:
        """As `Storage.messages`."""
        found = self._readable().iter_messages(
            selection.names, starting_at=selection.start_ns, ending_before=selection.stop_ns
        )
        for _, channel, message in found:
            yield RecordedMessage(
                topic=channel.topic,
                time_ns=message.log_time,
                data=decompress_message(message.data),
            )

    def times(self) -> Iterator[tuple[str, int]] | None:
        """As `Storage.times`: only the indexes of the chunks are read."""
        return None if self._summary is None else _times(self._stream, self._summary)

    def close(self) -> None:
        """As `Storage.close`."""
        self._stream.close()

    def _readable(self) -> McapReader:
        """Return a reader that skips no message."""
        if self._summary is not None:
            return self._reader
        self._stream.seek(0)
        return NonSeekingReader(self._stream, validate_crcs=True)

    def _count(self) -> tuple[TopicInfo, ...]:
        """Return the topics of a file without index: every message is looked at."""
        channels: dict[int, tuple[Channel, Schema | None]] = {}
        counts: dict[int, int] = {}
        spans_ns: dict[int, tuple[int, int]] = {}
        for schema, channel, message in self._readable().iter_messages(log_time_order=False):
            channels[channel.id] = (channel, schema)
            counts[channel.id] = counts.get(channel.id, 0) + 1
            time_ns = message.log_time
            first_ns, last_ns = spans_ns.get(channel.id, (time_ns, time_ns))
            spans_ns[channel.id] = (min(first_ns, time_ns), max(last_ns, time_ns))
        return tuple(
            _topic(*channels[number], counts[number], spans_ns[number]) for number in channels
        )


def _complete(summary: Summary | None) -> Summary | None:
    """Return a summary that lists every message; None if it does not."""
    if summary is None or summary.statistics is None or not summary.chunk_indexes:
        return None
    if any(not chunk.message_index_offsets for chunk in summary.chunk_indexes):
        return None
    counted = summary.statistics.channel_message_counts.keys()
    schemas = {channel.schema_id for channel in summary.channels.values()} - {_NO_SCHEMA}
    is_whole = counted <= summary.channels.keys() and schemas <= summary.schemas.keys()
    return summary if is_whole else None


def _topic(
    channel: Channel, schema: Schema | None, count: int, span_ns: tuple[int, int] | None
) -> TopicInfo:
    kind = "" if schema is None else schema.name
    qos = channel.metadata.get("offered_qos_profiles", "")
    return stored_topic(channel.topic, kind, channel.message_encoding, count, span_ns, qos)


def _spans_ns(stream: BinaryIO, chunks: list[ChunkIndex]) -> dict[int, tuple[int, int]]:
    """Return the times of the first and the last message of each channel, by its number.

    The indexes of chunks have the time of each message; only those are read that may have one of
    these times.

    Raises:
        DamagedStorageError, struct.error: an index is not where the summary says.
    """
    by_start = sorted(chunks, key=attrgetter("message_start_time"))
    by_end = sorted(chunks, key=attrgetter("message_end_time"), reverse=True)
    first_ns = _first_times(stream, by_start, attrgetter("message_start_time"), 1)
    last_ns = _first_times(stream, by_end, attrgetter("message_end_time"), -1)
    return {channel: (first_ns[channel], last_ns[channel]) for channel in first_ns}


def _first_times(
    stream: BinaryIO,
    chunks: list[ChunkIndex],
    bound: Callable[[ChunkIndex], int],
    sign: Literal[1, -1],
) -> dict[int, int]:
    """Return the time of the first message of each channel, or with `sign` -1 of the last one.

    The chunks are in the order of their bounds, beyond which they have no message.
    """
    times_ns: dict[int, int] = {}
    for chunk in chunks:
        for channel, offset in chunk.message_index_offsets.items():
            known_ns = times_ns.get(channel)
            if known_ns is not None and sign * bound(chunk) >= sign * known_ns:
                continue
            for time_ns in _indexed_times(stream, channel, offset):
                known_ns = times_ns.setdefault(channel, time_ns)
                times_ns[channel] = sign * min(sign * known_ns, sign * time_ns)
    return times_ns


def _times(stream: BinaryIO, summary: Summary) -> Iterator[tuple[str, int]]:
    for chunk in summary.chunk_indexes:
        for channel, offset in chunk.message_index_offsets.items():
            for time_ns in _indexed_times(stream, channel, offset):
                yield summary.channels[channel].topic, time_ns


def _indexed_times(stream: BinaryIO, channel: int, offset: int) -> Iterator[int]:
    """Yield the times of the messages of a channel in a chunk, from the index at an offset."""
    stream.seek(offset)
    kind, _, of, size = _INDEX.unpack(stream.read(_INDEX.size))
    if (kind, of) != (_INDEX_RECORD, channel):
        raise DamagedStorageError("its index does not match a chunk")
    for time_ns, _ in _INDEX_ENTRY.iter_unpack(stream.read(size)):
        yield time_ns
