"""sqlite3 storage, with checks for missing data that sqlite would not detect."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator
from pathlib import Path

from r2bspec.bags.recording import DataError, RecordedMessage, Selection, TopicInfo
from r2bspec.bags.storage.storage import (
    EMPTY_FILE,
    DamagedStorageError,
    decompress_message,
    stored_topic,
)
from r2bspec.safe_io.safe_file import is_regular, open_regular

_MAGIC = b"SQLite format 3\x00"
_HEADER_BYTES = 100
# Journals in the folder of a database, with changes that are not in the file itself.
_JOURNALS = {
    "-wal": (b"\x37\x7f\x06\x82", b"\x37\x7f\x06\x83"),
    "-journal": (b"\xd9\xd5\x05\xf9",),
}
_TOPICS = """
SELECT name, type, serialization_format, ifnull(number, 0), first_ns, last_ns, {qos}
FROM topics LEFT JOIN
(SELECT topic_id, count(*) AS number, min(timestamp) AS first_ns, max(timestamp) AS last_ns
FROM messages GROUP BY topic_id) ON topic_id = topics.id ORDER BY topics.id
"""


class SqliteStorage:
    """An open .db3 file."""

    def __init__(self, path: Path) -> None:
        # Journals lie beside the file itself, not beside a link to it.
        path = path.resolve()
        _check_complete(path)
        # It may be on a read-only disk, where no lock file can be made.
        uri = f"{path.as_uri()}?mode=ro&immutable=1"
        self._database = sqlite3.connect(uri, uri=True)

    def index(self) -> tuple[TopicInfo, ...]:
        """As `Storage.index`."""
        # Early versions have no such column.
        columns = [row[1] for row in self._database.execute("PRAGMA table_info(topics)")]
        qos = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
        return tuple(
            stored_topic(name, kind, serialization, count, (first_ns, last_ns), offered)
            for name, kind, serialization, count, first_ns, last_ns, offered in (
                self._database.execute(_TOPICS.format(qos=qos))
            )
        )

    def messages(self, selection: Selection) -> Iterator[RecordedMessage]:
        """As `Storage.messages`."""
        topics = {
            number: name
            for number, name in self._database.execute("SELECT id, name FROM topics")
            if name in selection.names
        }
        first_ns = -(2**63) if selection.start_ns is None else selection.start_ns
        past_ns = 2**63 - 1 if selection.stop_ns is None else selection.stop_ns
        marks = ", ".join("?" * len(topics))
        rows = self._database.execute(
            f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks})"  # noqa: S608 - question marks
            " AND timestamp >= ? AND timestamp < ? ORDER BY timestamp, rowid",
            (*topics, first_ns, past_ns),
        )
        for number, time_ns, data in rows:
            yield RecordedMessage(
                topic=topics[number], time_ns=int(time_ns), data=decompress_message(data)
            )

    def times(self) -> Iterator[tuple[str, int]]:
        """As `Storage.times`: the pages of a large message that follow its first are not read."""
        return self._database.execute(
            "SELECT name, timestamp FROM messages JOIN topics ON topics.id = topic_id"
        )

    def close(self) -> None:
        """As `Storage.close`."""
        self._database.close()


def _check_complete(path: Path) -> None:
    """Check for missing data that sqlite would not detect.

    For a file that is opened as immutable, sqlite neither looks for a journal nor at the size of
    the file (https://www.sqlite.org/fileformat2.html, sections 1.3 and 4).

    Raises:
        DamagedStorageError: it is not a database, or not all of it is there.
        DataError: R2B313.
    """
    with open_regular(path) as stream:
        head = stream.read(_HEADER_BYTES)
    if len(head) < _HEADER_BYTES or not head.startswith(_MAGIC):
        raise DamagedStorageError("it is not a sqlite3 database" if head else EMPTY_FILE)
    (page_bytes,) = struct.unpack_from(">H", head, 16)
    changed, pages = struct.unpack_from(">II", head, 24)
    (valid_for,) = struct.unpack_from(">I", head, 92)
    # 65,536 does not fit into the field and is written as 1.
    expected = pages * (65_536 if page_bytes == 1 else page_bytes)
    file_size = path.stat().st_size
    if changed == valid_for and file_size < expected:
        raise DamagedStorageError(
            f"it has {file_size:,} bytes of {expected:,}",
            "the file is incomplete; copy or record it again",
        )
    for suffix, magics in _JOURNALS.items():
        journal = path.with_name(path.name + suffix)
        if is_regular(journal):
            with open_regular(journal) as stream:
                if stream.read(4) in magics:
                    raise DataError(
                        f"{path} was not closed: some of its messages are only in {journal.name}",
                        code="R2B313",
                        hint="end the recorder, or after a crash merge both files with"
                        f" \"sqlite3 '{path}' 'PRAGMA wal_checkpoint(TRUNCATE)'\"",
                    )
