"""MCAP storage, read by `rosbags` in one of two ways.

Files with a complete index are read chunk by chunk. `rosbags` silently skips messages that are not
in the index: messages outside of chunks in files with chunks, and chunks that were written without
an index of their messages. Such files are read sequentially.
"""

from __future__ import annotations

import heapq
import struct
from binascii import crc32
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import count
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal

from r2bspec.bags.recording import (
    DataError,
    RecordedMessage,
    Selection,
    TopicInfo,
    unreadable,
    with_span,
)
from r2bspec.bags.storage.storage import decompress_message, no_profiles, stored_topic
from r2bspec.safe_io import decompression_budget as budget
from r2bspec.safe_io.limits import MAX_PIECE_BYTES
from r2bspec.safe_io.safe_file import open_regular

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

_MAGIC = b"\x89MCAP0\r\n"
_HEADER_RECORD = 1
# Opcode and length, then two offsets and a checksum, then the magic.
_FOOTER = struct.Struct("<BQQQI8s")
# Opcode and length, then the times of the first and the last message.
_CHUNK = struct.Struct("<BQQQ")
_CHUNK_RECORD = 6
# Opcode and length, then the channel and the bytes of the entries: a time and an offset for each.
_INDEX = struct.Struct("<BQHI")
_INDEX_RECORD = 7
_INDEX_ENTRY = struct.Struct("<QQ")
_LENGTH = struct.Struct("<Q")
_BLOCK_BYTES = 1 << 20


class McapStorage:
    """An open .mcap file."""

    def __init__(self, path: Path, display_path: Path) -> None:
        from rosbags.rosbag2 import Reader, storage_mcap

        _check_profile(path, display_path)
        has_summary = _check_summary(path)
        # Let `rosbags` unpack chunks no further than they state, and than a limit; no more records
        # than a file of this size needs; and nothing that is not asked for.
        storage_mcap.DECOMPRESSORS.update(zstd=budget.unpack_zstd, lz4=budget.unpack_lz4)
        vars(storage_mcap).update(
            skip_sized=_skip_record,
            read_sized=_read_record,
            skip_exact=_skip_message,
            parse_qos=no_profiles,
        )
        self._path = path
        self._stored_bytes = path.stat().st_size
        with ExitStack() as stack, budget.DecompressionBudget(self._stored_bytes).active():
            reader = stack.enter_context(Reader(path))
            file: Any = reader.storage
            _check_chunks(path, file.chunks)
            _check_unpacked_sizes(self._stored_bytes, file.chunks)
            self._indexed = _is_indexed(file)
            if not self._indexed:
                stated: Counter[int] = Counter(file.statistics.channel_message_counts)
                budget.DecompressionBudget(self._stored_bytes).spend_messages(stated.total())
                if has_summary:  # else its records were counted when it was opened
                    with budget.DecompressionBudget(self._stored_bytes).active():
                        file.meta_scan()
                _check_counts(stated, Counter(file.statistics.channel_message_counts), display_path)
            self._stack = stack.pop_all()
        self._file = file
        statistics = file.statistics
        self._connections: list[Connection] = reader.connections
        self.topics = tuple(
            stored_topic(connection, statistics.channel_message_counts.get(connection.id, 0))
            for connection in self._connections
        )
        self.message_count = statistics.message_count
        self.start_ns = statistics.start_time
        self.end_ns = statistics.end_time

    def timed_topics(self) -> Iterator[TopicInfo]:
        """As `Storage.timed_topics`."""
        spans_ns = _spans_ns(self._path, self._file.chunks) if self._indexed else {}
        for topic, connection in zip(self.topics, self._connections, strict=True):
            yield with_span(topic, spans_ns.get(connection.id))

    def messages(self, selection: Selection) -> Iterator[RecordedMessage]:
        """As `Storage.messages`."""
        connections = [link for link in self._connections if link.topic in selection.names]
        read = self._file.messages if self._indexed else self._messages_by_time
        stored = read(connections, selection.start_ns, selection.stop_ns)
        messages = (
            RecordedMessage(topic=connection.topic, time_ns=time_ns, data=decompress_message(data))
            for connection, time_ns, data in stored
        )
        limits = budget.DecompressionBudget(self._stored_bytes, self.message_count)
        yield from budget.spend_for_each(messages, limits)

    def close(self) -> None:
        """As `Storage.close`."""
        self._stack.close()

    def _messages_by_time(
        self, connections: list[Connection], start_ns: int | None, stop_ns: int | None
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Messages of a file without index, in order of time; unordered ones are kept in memory.

        A first pass reads the times. In the second one, a message is kept until all older messages
        have been read.
        """
        import numpy as np

        scan = self._file.messages_scan
        times = np.fromiter((row[1] for row in scan(connections, start_ns, stop_ns)), np.int64)
        # oldest[i]: the smallest time of message i and all after it.
        oldest = np.minimum.accumulate(times[::-1])[::-1]
        heap: list[tuple[int, int, Connection, bytes]] = []
        numbers = count()
        for number, (connection, time_ns, data) in zip(
            numbers, scan(connections, start_ns, stop_ns), strict=False
        ):
            heapq.heappush(heap, (time_ns, number, connection, data))
            while heap and (number + 1 == len(times) or heap[0][0] <= oldest[number + 1]):
                earliest_ns, _, of, content = heapq.heappop(heap)
                yield of, earliest_ns, content


def _check_unpacked_sizes(stored_bytes: int, chunks: list[Any]) -> None:
    """Compare what the index says that the chunks unpack to with the limits.

    Raises:
        RefusedDataError: it is too much.
    """
    with budget.DecompressionBudget(stored_bytes).active():
        for chunk in chunks:
            budget.check_piece(chunk.compressed_size, chunk.uncompressed_size)


def _is_indexed(file: Any) -> bool:
    """Whether the index lists every message that the statistics count."""
    if any(not chunk_index.message_index_offsets for chunk_index in file.chunks):
        return False
    listed: Counter[int] = Counter()
    for chunk in file.chunks:
        listed.update(chunk.channel_count)
    return +listed == +Counter(file.statistics.channel_message_counts)


def _spans_ns(path: Path, chunks: list[Any]) -> dict[int, tuple[int, int]]:
    """The times of the first and the last message of each channel, by its number.

    The indexes of chunks have the time of each message; only those are read that may have one of
    these times.

    Raises:
        ValueError, struct.error: an index is not where the summary says.
    """
    by_start = sorted(chunks, key=attrgetter("message_start_time"))
    by_end = sorted(chunks, key=attrgetter("message_end_time"), reverse=True)
    with open_regular(path) as stream:
        first_ns = _first_times(stream, by_start, attrgetter("message_start_time"), 1)
        last_ns = _first_times(stream, by_end, attrgetter("message_end_time"), -1)
    return {channel: (first_ns[channel], last_ns[channel]) for channel in first_ns}


def _first_times(
    stream: BinaryIO, chunks: list[Any], bound: Callable[[Any], int], sign: Literal[1, -1]
) -> dict[int, int]:
    """The time of the first message of each channel, or with `sign` -1 of the last one.

    The chunks are in the order of their bounds, beyond which they have no message.
    """
    times_ns: dict[int, int] = {}
    for chunk in chunks:
        for channel, offset in chunk.message_index_offsets.items():
            found_ns = times_ns.get(channel)
            if found_ns is not None and sign * bound(chunk) >= sign * found_ns:
                continue
            stream.seek(offset)
            kind, size, of, _ = _INDEX.unpack(stream.read(_INDEX.size))
            entries = stream.read(size - 6) if 6 <= size <= MAX_PIECE_BYTES else b""
            if (kind, of) != (_INDEX_RECORD, channel) or len(entries) != size - 6:
                raise ValueError("its index does not match a chunk")
            for time_ns, _ in _INDEX_ENTRY.iter_unpack(entries):
                known_ns = times_ns.setdefault(channel, time_ns)
                times_ns[channel] = sign * min(sign * known_ns, sign * time_ns)
    return times_ns


def _check_counts(stated: Counter[int], found: Counter[int], display_path: Path) -> None:
    # A file may be written without statistics.
    if +stated and +stated != +found:
        raise unreadable(
            display_path,
            f"its summary states {stated.total():,} messages, but it has {found.total():,}",
            "the file is damaged; 'mcap recover' writes its readable messages to a new one",
        )


def _check_profile(path: Path, display_path: Path) -> None:
    """Check that the profile of an MCAP file is that of ROS 2.

    Raises:
        DataError: R2B304.
    """
    with open_regular(path) as stream:
        head = stream.read(len(_MAGIC) + 13)
        if len(head) < len(_MAGIC) + 13 or not head.startswith(_MAGIC) or head[8] != _HEADER_RECORD:
            raise unreadable(display_path, "it does not begin like an MCAP file")
        (length,) = struct.unpack_from("<I", head, 17)
        profile = stream.read(min(length, 64)).decode(errors="replace")
    if profile != "ros2":
        raise DataError(
            f"{display_path} has the MCAP profile {profile!r}; only 'ros2' is supported",
            code="R2B304",
            hint="convert it with 'mcap convert', or record it with 'ros2 bag record'",
        )


def _check_chunks(path: Path, chunks: list[Any]) -> None:
    """Compare the times of chunks in the index with those in the chunks.

    See https://mcap.dev/spec, "Chunk" and "Chunk Index".

    Raises:
        ValueError, struct.error: they differ, or there is no chunk where one should be.
    """
    with open_regular(path) as stream:
        for chunk in chunks:
            stream.seek(chunk.chunk_start_offset)
            # For a truncated chunk, `struct` raises its error here.
            kind, _, start_ns, end_ns = _CHUNK.unpack(stream.read(_CHUNK.size))
            stated = (chunk.message_start_time, chunk.message_end_time)
            if kind != _CHUNK_RECORD or (start_ns, end_ns) != stated:
                raise ValueError("its index does not match a chunk")


def _check_summary(path: Path) -> bool:
    """Compare the summary, which contains the index, with its checksum (0: there is none).

    See https://mcap.dev/spec, "Footer".

    Returns:
        Whether there is one.

    Raises:
        ValueError: they differ, or there is no footer.
    """
    with open_regular(path) as stream:
        size = stream.seek(0, 2)
        if size < _FOOTER.size + len(_MAGIC):
            raise ValueError("it ends before its footer")
        stream.seek(size - _FOOTER.size)
        _, _, start, _, stated, magic = _FOOTER.unpack(stream.read(_FOOTER.size))
        if magic != _MAGIC:
            raise ValueError("it ends before its footer")
        if not stated:
            return bool(start)
        end = size - len(_MAGIC) - 4
        begin = stream.seek(start or size - _FOOTER.size)
        record_count = 0
        while begin < end and (block := stream.read(min(_BLOCK_BYTES, end - begin))):
            record_count = crc32(block, record_count)
            begin += len(block)
    if record_count != stated:
        raise ValueError("the checksum of its summary is wrong")
    return bool(start)


def _skip_record(stream: BinaryIO) -> None:
    """In place of `rosbags`: a record that nothing asks for counts."""
    budget.spend_record()
    # The opcode has been read. 0 is none: a hole of a terabyte would have 100 billion of them.
    stream.seek(-1, 1)
    if stream.read(1) == b"\0":
        raise ValueError("it has a record without an opcode")
    (size,) = _LENGTH.unpack(stream.read(_LENGTH.size))
    place = stream.tell()
    if stream.seek(place + size) != place + size:
        raise ValueError("it ends inside of a record")


def _skip_message(stream: BinaryIO, size: int) -> None:
    """In place of `rosbags`, which uses it while messages are counted."""
    budget.spend_message()
    place = stream.tell()
    if stream.seek(place + size) != place + size:
        raise ValueError("it ends inside of a message")


def _read_record(stream: BinaryIO) -> bytes:
    """In place of `rosbags`: a record but for messages counts."""
    budget.spend_record()
    (size,) = _LENGTH.unpack(stream.read(_LENGTH.size))
    content = stream.read(size) if size <= MAX_PIECE_BYTES else b""
    if len(content) != size:
        raise ValueError(f"a record states {size:,} bytes")
    return content
