"""sqlite3 storage, read by `rosbags`, after checks for damage that it would not detect."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from r2bspec.bags.recording import (
    DataError,
    RecordedMessage,
    Selection,
    TopicInfo,
    unreadable,
    with_span,
)
from r2bspec.bags.storage.storage import check_topics, decompress_ahead, no_profiles, stored_topic
from r2bspec.safe_io.decompression_budget import DecompressionBudget
from r2bspec.safe_io.limits import MAX_DEFINITIONS, MAX_TOPIC_TEXT_BYTES, MAX_VALUE_BYTES
from r2bspec.safe_io.private_files import temporary_folder
from r2bspec.safe_io.safe_file import RefusedDataError, is_regular, open_regular
from r2bspec.safe_io.safe_sqlite import STEPS_BETWEEN_CALLS, open_read_only

_TABLES = ("messages", "topics", "schema", "metadata", "message_definitions")
_MAGIC = b"SQLite format 3\x00"
_HEADER_BYTES = 100
# Journals in the folder of a database, with changes that are not in the file itself.
_JOURNALS = {
    "-wal": (b"\x37\x7f\x06\x82", b"\x37\x7f\x06\x83"),
    "-journal": (b"\xd9\xd5\x05\xf9",),
}
# Characters that have a meaning in the URI by which the file is opened.
_URI_SPECIAL = frozenset("?#%")


class SqliteStorage:
    """An open .db3 file."""

    def __init__(self, path: Path, display_path: Path) -> None:
        from rosbags.rosbag2 import Reader, storage_sqlite3

        # Nothing asks for the QoS of a file, and parsing it takes longer than reading the file.
        vars(storage_sqlite3).update(parse_qos=no_profiles)
        real = path.resolve()
        _check_complete(real, display_path)
        self._path = real
        self._stored_bytes = real.stat().st_size
        self._has_index = _check_topics(real)
        with ExitStack() as stack:
            self._reader = stack.enter_context(Reader(_uri_safe_path(real, stack)))
            _restrict(self._reader.storage)
            self._stack = stack.pop_all()
        self.topics = tuple(
            stored_topic(connection, connection.msgcount) for connection in self._reader.connections
        )
        self.message_count = self._reader.message_count
        self.start_ns = self._reader.start_time
        # rosbags gives the first instant after the last message.
        self.end_ns = self._reader.end_time - 1
        _check_time(self.start_ns)
        _check_time(self.end_ns)
        topic_total = sum(topic.count for topic in self.topics)
        if topic_total != self.message_count:
            self.close()
            raise unreadable(
                display_path,
                f"it has {self.message_count:,} messages by its index, but {topic_total:,} by its "
                "topics",
                "the file is damaged; copy or record it again",
            )

    def timed_topics(self) -> Iterator[TopicInfo]:
        """As `Storage.timed_topics`."""
        spans_ns = _spans_ns(self._path)
        for topic, connection in zip(self.topics, self._reader.connections, strict=True):
            yield with_span(topic, spans_ns.get(connection.id))

    def messages(self, selection: Selection) -> Iterator[RecordedMessage]:
        """As `Storage.messages`."""
        links = [link for link in self._reader.connections if link.topic in selection.names]
        stored: Iterator[tuple[tuple[str, int], bytes]]
        if self._has_index:
            rows = self._reader.messages(links, selection.start_ns, selection.stop_ns)
            stored = (((link.topic, time_ns), data) for link, time_ns, data in rows)
        else:
            stored = _row_by_row(self._path, {link.id: link.topic for link in links}, selection)
        for (topic, time_ns), data in decompress_ahead(
            stored, DecompressionBudget(self._stored_bytes)
        ):
            _check_time(time_ns)
            yield RecordedMessage(topic=topic, time_ns=time_ns, data=data)

    def close(self) -> None:
        """As `Storage.close`."""
        self._stack.close()


def _spans_ns(path: Path) -> dict[int, tuple[int, int]]:
    """The times of the first and the last message of each topic that has some, by its number."""
    with open_read_only(path, tables=_TABLES) as database:
        rows = database.execute(
            "SELECT topic_id, min(timestamp), max(timestamp) FROM messages GROUP BY topic_id"
        )
        spans_ns = {topic: (first_ns, last_ns) for topic, first_ns, last_ns in rows}
    for span_ns in spans_ns.values():
        for time_ns in span_ns:
            _check_time(time_ns)
    return spans_ns


def _check_time(time_ns: object) -> None:
    """Refuse a time of another type: SQLite keeps a value of any type in any column."""
    if not isinstance(time_ns, int):
        raise RefusedDataError("a message has a time that is no integer")


def _restrict(storage: Any) -> None:
    """Limit the connection of `rosbags`; its schema has been checked."""
    import apsw

    connection: apsw.Connection = storage.dbconn
    connection.limit(apsw.SQLITE_LIMIT_LENGTH, MAX_VALUE_BYTES)
    # Signals are handled in Python code only: without this, a long query cannot be interrupted.
    connection.set_progress_handler(lambda: False, STEPS_BETWEEN_CALLS)


def _check_topics(path: Path) -> bool:
    """Compare the topics with the limits before `rosbags` reads them.

    Returns:
        Whether messages are indexed by their times, as those of rosbag2 are.

    Raises:
        RefusedDataError: they exceed one, or have other values than texts.
        sqlite3.Error: the database is damaged.
    """
    with open_read_only(path, tables=_TABLES) as database:
        ((number, *lengths),) = database.execute(
            "SELECT count(*), max(length(name)), max(length(type)) FROM topics"
        )
        check_topics(number, max(length or 0 for length in lengths))
        ((others,),) = database.execute(
            "SELECT count(*) FROM topics WHERE typeof(name) <> 'text' OR typeof(type) <> 'text'"
            " OR typeof(serialization_format) <> 'text'"
        )
        if others:
            raise RefusedDataError("a topic has a name or a type that is no text")
        for table, column in (
            ("topics", "offered_qos_profiles"),
            ("message_definitions", "encoded_message_definition"),
        ):
            columns = database.execute("SELECT name FROM pragma_table_info(?)", (table,))
            if (column,) in list(columns):
                sizes = f"SELECT count(*), total(length({column})) FROM {table}"  # noqa: S608
                ((number, size),) = database.execute(sizes)
                _check_texts(table, number, int(size))
        first_columns = database.execute(
            "SELECT of_index.name FROM pragma_index_list('messages') AS list"
            " JOIN pragma_index_info(list.name) AS of_index WHERE of_index.seqno = 0"
        )
        return ("timestamp",) in list(first_columns)


def _check_texts(table: str, number: int, size: int) -> None:
    """Refuse texts that `rosbags` reads at once, and definitions that it compares with all topics.

    Raises:
        RefusedDataError: they are too many, or too large.
    """
    if size > MAX_TOPIC_TEXT_BYTES:
        raise RefusedDataError(
            f"its table {table} has texts of {size:,} bytes; the limit is {MAX_TOPIC_TEXT_BYTES:,}"
        )
    if table == "message_definitions" and number > MAX_DEFINITIONS:
        raise RefusedDataError(f"it defines {number:,} types; the limit is {MAX_DEFINITIONS:,}")


def _row_by_row(
    path: Path, topics: dict[int, str], selection: Selection
) -> Iterator[tuple[tuple[str, int], bytes]]:
    """Messages of a file without index; sqlite would sort them with their bodies, in memory."""
    marks = ", ".join("?" * len(topics))
    first_ns = -(2**63) if selection.start_ns is None else selection.start_ns
    past_ns = 2**63 - 1 if selection.stop_ns is None else selection.stop_ns
    with open_read_only(path, tables=_TABLES) as database:
        rows = database.execute(
            f"SELECT rowid, topic_id, timestamp FROM messages WHERE topic_id IN ({marks})"  # noqa: S608 - question marks
            " AND timestamp >= ? AND timestamp < ? ORDER BY timestamp, rowid",
            (*topics, first_ns, past_ns),
        )
        for row, topic, time_ns in rows:
            ((data,),) = database.execute("SELECT data FROM messages WHERE rowid = ?", (row,))
            yield (topics[topic], time_ns), data


def _check_complete(path: Path, display_path: Path) -> None:
    """Check for missing data that sqlite would not detect.

    A recording is opened as immutable, because it may lie on a read-only disk, where no lock
    file can be made. sqlite then neither looks for a journal nor at the size of the file
    (https://www.sqlite.org/fileformat2.html, sections 1.3 and 4).

    Raises:
        DataError: R2B304 or R2B313.
    """
    with open_regular(path) as stream:
        head = stream.read(_HEADER_BYTES)
    if len(head) < _HEADER_BYTES or not head.startswith(_MAGIC):
        raise unreadable(display_path, "it is not a sqlite3 database")
    (page_bytes,) = struct.unpack_from(">H", head, 16)
    changed, pages = struct.unpack_from(">II", head, 24)
    (valid_for,) = struct.unpack_from(">I", head, 92)
    # 65,536 does not fit into the field and is written as 1.
    expected = pages * (65_536 if page_bytes == 1 else page_bytes)
    file_size = path.stat().st_size
    if changed == valid_for and file_size < expected:
        raise unreadable(
            display_path,
            f"it has {file_size:,} bytes of {expected:,}",
            "the file is incomplete; copy or record it again",
        )
    for suffix, magics in _JOURNALS.items():
        journal = path.with_name(path.name + suffix)
        if is_regular(journal):
            with open_regular(journal) as stream:
                if stream.read(4) in magics:
                    raise DataError(
                        f"{display_path} was not closed: some of its messages are only in "
                        f"{journal.name}",
                        code="R2B313",
                        hint="end the recorder, or after a crash merge both files with"
                        f" \"sqlite3 '{path}' 'PRAGMA wal_checkpoint(TRUNCATE)'\"",
                    )


def _uri_safe_path(path: Path, stack: ExitStack) -> Path:
    """A path to the same file with only characters that `rosbags` can write into its URI."""
    # The bytes of a name that is not UTF-8 are lone surrogates.
    if (
        _URI_SPECIAL.isdisjoint(name := str(path))
        and name == name.encode(errors="replace").decode()
    ):
        return path
    folder = stack.enter_context(temporary_folder("link"))
    link = folder / "bag.db3"
    link.symlink_to(path)
    return link
