"""ROS 1 storage, read by `rosbags`; each message is converted to the CDR of ROS 2.

Types have the names of ROS 2 (``sensor_msgs/Image`` is ``sensor_msgs/msg/Image``), headers lose
their ``seq``, and types with another layout in ROS 2 are migrated field by field.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from r2bspec.bags.recording import (
    DataError,
    RecordedMessage,
    Selection,
    TopicInfo,
    error_text,
    with_span,
)
from r2bspec.safe_io import decompression_budget as budget
from r2bspec.safe_io.limits import MAX_DEFINITION_LINES, MAX_FIXED_VALUES
from r2bspec.safe_io.safe_file import open_regular

if TYPE_CHECKING:
    from rosbags.interfaces import Connection, Typestore
    from rosbags.rosbag1 import Reader

# Types that ROS 2 has under another name.
_ROS2_NAMES = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}


_Converter = Callable[[bytes], bytes]


class Ros1Storage:
    """An open .bag file."""

    def __init__(self, path: Path, display_path: Path) -> None:
        from rosbags.rosbag1 import Reader
        from rosbags.rosbag1.reader import decompressors

        # Let `rosbags` unpack chunks up to a limit.
        decompressors.update(bz2=budget.unpack_bz2, lz4=budget.unpack_lz4)
        self._stored_bytes = path.stat().st_size
        self._display_path = display_path
        self._reader = Reader(path)
        self._reader.open()
        try:
            _check_index(path, self._reader)
        except BaseException:
            self._reader.close()
            raise
        self.topics = tuple(
            TopicInfo(name=connection.topic, type=_type(connection), count=connection.msgcount)
            for connection in self._reader.connections
        )
        self.message_count = sum(topic.count for topic in self.topics)
        self.start_ns = self._reader.start_time
        # rosbags gives the first instant after the last message.
        self.end_ns = self._reader.end_time - 1

    def timed_topics(self) -> Iterator[TopicInfo]:
        """As `Storage.timed_topics`."""
        for topic, connection in zip(self.topics, self._reader.connections, strict=True):
            times_ns = [entry.time for entry in self._reader.indexes.get(connection.id, ())]
            yield with_span(topic, (min(times_ns), max(times_ns)) if times_ns else None)

    def messages(self, selection: Selection) -> Iterator[RecordedMessage]:
        """As `Storage.messages`.

        Raises:
            DataError: a type cannot be converted (R2B306).
        """
        connections = [link for link in self._reader.connections if link.topic in selection.names]
        converters = {connection_.id: self._converter(connection_) for connection_ in connections}
        stored = budget.spend_for_each(
            self._reader.messages(connections, selection.start_ns, selection.stop_ns),
            budget.DecompressionBudget(self._stored_bytes),
        )
        for connection, time_ns, data in stored:
            converted = converters[connection.id](data)
            yield RecordedMessage(topic=connection.topic, time_ns=time_ns, data=converted)

    def close(self) -> None:
        """As `Storage.close`."""
        self._reader.close()

    def _converter(self, connection: Connection) -> _Converter:
        try:
            return _converter(connection.msgtype, connection.msgdef.data, _type(connection))
        # Definitions are text of the recording, so parsing them may raise any exception.
        except Exception as error:
            raise DataError(
                f"{self._display_path} has {connection.topic} as {connection.msgtype}, which "
                f"cannot be converted to ROS 2: {error_text(error)}",
                code="R2B306",
                hint="convert the bag with a tool that supports the type",
            ) from error


def _check_index(path: Path, reader: Reader) -> None:
    """Compare the index with the file: with a wrong count in the header, messages are missing.

    Raises:
        ValueError: they differ.
    """
    from rosbags.rosbag1.reader import Header, RecordType, read_uint32

    record_counts: Counter[int] = Counter()
    with open_regular(path) as stream:
        size = stream.seek(0, 2)
        stream.seek(0)
        stream.readline()
        stream.seek(Header.read(stream, RecordType.BAGHEADER).get_uint64("index_pos"))
        while reader.chunk_infos and stream.tell() < size:
            record_counts[Header.read(stream).get_uint8("op")] += 1
            stream.seek(read_uint32(stream), 1)
    if (record_counts[RecordType.CONNECTION], record_counts[RecordType.CHUNK_INFO]) != (
        len(reader.connections),
        len(reader.chunk_infos),
    ):
        raise ValueError("the numbers of chunks or connections in its header and its index differ")
    if len({chunk.pos for chunk in reader.chunk_infos}) != len(reader.chunk_infos):
        raise ValueError("its index has a chunk more than once")
    stated: Counter[int] = Counter()
    for chunk in reader.chunk_infos:
        stated.update(chunk.connection_counts)
    if +stated != +Counter(
        {connection.id: connection.msgcount for connection in reader.connections}
    ):
        raise ValueError("the numbers of messages in its index and its chunks differ")


def _type(connection: Connection) -> str:
    return _ROS2_NAMES.get(connection.msgtype, connection.msgtype)


def _check_length(definition: str) -> None:
    """Refuse a definition that takes long to parse.

    Raises:
        ValueError: it has too many lines.
    """
    lines = sum(1 for line in definition.splitlines() if not line.lstrip().startswith("#"))
    if lines > MAX_DEFINITION_LINES or len(definition) > 100 * MAX_DEFINITION_LINES:
        raise ValueError(
            f"its definition has {lines:,} lines and {len(definition):,} characters; the limits "
            f"are {MAX_DEFINITION_LINES:,} lines and 100 characters for each"
        )


def _check_size(types: Typestore, recorded: str) -> None:
    """Refuse a type of which a short definition makes very many values.

    Raises:
        ValueError: arrays in arrays have too many values, or a type contains itself.
    """
    from rosbags.interfaces import Nodetype

    sizes: dict[str, int] = {}

    def of_type(name: str, within: frozenset[str]) -> int:
        if name in within:
            raise ValueError(f"{name} contains itself")
        if name not in sizes:
            fields = types.fielddefs[name][1]
            sizes[name] = sum(of_field(field, within | {name}) for _, field in fields)
            if sizes[name] > MAX_FIXED_VALUES:
                raise ValueError(f"{name} has more than {MAX_FIXED_VALUES:,} values")
        return sizes[name]

    def of_field(field: Any, within: frozenset[str]) -> int:
        kind, content = field
        if kind == Nodetype.BASE:
            return 1
        if kind == Nodetype.NAME:
            return of_type(content, within)
        element, number = content
        if element[0] == Nodetype.BASE and element[1][0] != "string":
            return 1
        size = of_field(element, within)
        return 1 if kind == Nodetype.SEQUENCE else number * max(size, 1)

    of_type(recorded, frozenset())


@cache
def _converter(recorded: str, definition: str, wanted: str) -> _Converter:
    """The conversion of messages of one recorded type to CDR.

    Args:
        recorded: name of the type in the recording.
        definition: its text, with those of all types that it contains.
        wanted: name of the type in ROS 2.
    """
    from rosbags.convert.converter import is_same_wireformat, migrate_bytes
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    _check_length(definition)
    source = get_typestore(Stores.EMPTY)
    source.register(get_types_from_msg(definition, recorded))
    _check_size(source, recorded)
    target = get_typestore(Stores.ROS2_JAZZY)
    # A user-defined type is assumed to be equal in ROS 2, except for types that it contains.
    own = {name: field for name, field in source.fielddefs.items() if name not in target.fielddefs}
    target.register(own)
    if is_same_wireformat(source, target, recorded, wanted):
        return lambda data: bytes(target.ros1_to_cdr(data, wanted))
    defaults: dict[str, Any] = {}
    return lambda data: bytes(
        migrate_bytes(source, target, recorded, wanted, defaults, data, src_is2=False, dst_is2=True)
    )
