"""ROS 1 storage: `rosbags` reads it, and each message becomes the CDR that ROS 2 would have sent.

Types keep their names in the way of ROS 2 (``sensor_msgs/Image`` is ``sensor_msgs/msg/Image``),
headers lose their ``seq``, and what is laid out otherwise in ROS 2 is migrated field by field.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from r2bspec.bags.errors import SERIALIZATION_UNSUPPORTED, DataError
from r2bspec.bags.recording import Message
from r2bspec.bags.storage.storage import StoredTopic
from r2bspec.untrusted.decompression_budget import (
    DecompressionBudget,
    spend_for_each,
    unpack_bz2,
    unpack_lz4,
)
from r2bspec.untrusted.safe_file import open_regular

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader

# Types that ROS 2 has under another name.
_ROS2_NAMES = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}

_Converter = Callable[[bytes], bytes]


class Ros1Storage:
    """An open .bag file."""

    def __init__(self, path: Path, display_path: Path) -> None:
        from rosbags.rosbag1 import Reader

        _bound_decompression()
        self._stored_bytes = path.stat().st_size
        self._display_path = display_path
        self._reader = Reader(path)
        self._reader.open()
        try:
            _check_index(path, self._reader)
        except BaseException:
            self._reader.close()
            raise
        counts = {each.id: each.msgcount for each in self._reader.connections}
        self.topics = tuple(
            StoredTopic(each.topic, _type(each), "cdr", counts[each.id])
            for each in self._reader.connections
        )
        self.message_count = sum(counts.values())
        self.start_ns = self._reader.start_time
        # rosbags gives the first instant after the last message.
        self.end_ns = self._reader.end_time - 1

    def messages(
        self, names: Collection[str], start_ns: int | None, stop_ns: int | None
    ) -> Iterator[Message]:
        """As `Storage.messages`.

        Raises:
            DataError: a type cannot be converted (R2B306).
        """
        connections = [each for each in self._reader.connections if each.topic in names]
        if not connections:
            return
        converters = {each.id: self._converter(each) for each in connections}
        stored = spend_for_each(
            self._reader.messages(connections, start_ns, stop_ns),
            DecompressionBudget(self._stored_bytes),
        )
        for connection, time_ns, data in stored:
            converted = converters[connection.id](data)
            yield Message(topic=connection.topic, time_ns=time_ns, data=converted)

    def close(self) -> None:
        """As `Storage.close`."""
        self._reader.close()

    def _converter(self, connection: Connection) -> _Converter:
        try:
            return _converter(connection.msgtype, connection.msgdef.data, _type(connection))
        # Definitions are text of the recording: what is wrong with them shows in any way.
        except Exception as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise DataError(
                f"{self._display_path} holds {connection.topic} as {connection.msgtype}, "
                "which cannot be"
                f" converted to ROS 2: {reason}",
                code=SERIALIZATION_UNSUPPORTED,
                hint="convert the bag with a tool that knows the type",
            ) from error


def _bound_decompression() -> None:
    """Let `rosbags` unpack chunks up to a limit."""
    from rosbags.rosbag1 import reader

    reader.decompressors.update(bz2=unpack_bz2, lz4=unpack_lz4)


def _check_index(path: Path, reader: Reader) -> None:
    """Compare what was read with what is there: a wrong count in the header hides messages.

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
        msg = "its header states other numbers of chunks or connections than its index has"
        raise ValueError(msg)
    stated: Counter[int] = Counter()
    for chunk in reader.chunk_infos:
        stated.update(chunk.connection_counts)
    if +stated != +Counter({each.id: each.msgcount for each in reader.connections}):
        msg = "its index has other numbers of messages than its chunks"
        raise ValueError(msg)


def _type(connection: Connection) -> str:
    return _ROS2_NAMES.get(connection.msgtype, connection.msgtype)


@cache
def _converter(recorded: str, definition: str, wanted: str) -> _Converter:
    """How messages of one recorded type become CDR.

    Args:
        recorded: name of the type in the recording.
        definition: its text, with those of all types that it contains.
        wanted: name of the type in ROS 2.
    """
    from rosbags.convert.converter import is_same_wireformat, migrate_bytes
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    source = get_typestore(Stores.EMPTY)
    source.register(get_types_from_msg(definition, recorded))
    target = get_typestore(Stores.ROS2_JAZZY)
    # A type of the user's own is taken to be the same in ROS 2, but for what it contains.
    own = {name: each for name, each in source.fielddefs.items() if name not in target.fielddefs}
    target.register(own)
    if is_same_wireformat(source, target, recorded, wanted):
        return lambda data: bytes(target.ros1_to_cdr(data, wanted))
    defaults: dict[str, Any] = {}
    return lambda data: bytes(
        migrate_bytes(source, target, recorded, wanted, defaults, data, src_is2=False, dst_is2=True)
    )
