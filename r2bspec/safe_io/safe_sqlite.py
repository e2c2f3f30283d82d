"""Opening SQLite databases of others: plain tables only, and queries that end.

A database can contain programs: views and triggers with recursive queries, generated columns, and
virtual tables. They run when a table of the expected name is read. All are refused.
"""

from __future__ import annotations

import re
import sqlite3
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from r2bspec.safe_io.limits import MAX_SCHEMA_OBJECTS, MAX_SCHEMA_S, MAX_VALUE_BYTES
from r2bspec.safe_io.safe_file import RefusedDataError

STEPS_BETWEEN_CALLS: Final = 100_000
_GENERATED: Final = frozenset((2, 3))
"""What the column `hidden` of table_xinfo says of a generated column."""
_VIRTUAL: Final = re.compile(r"\s*CREATE\s+VIRTUAL\s+TABLE", re.IGNORECASE)
_HINT: Final = "it was not written by a recorder; copy or record it again"


@contextmanager
def open_read_only(path: Path, *, tables: Collection[str]) -> Iterator[sqlite3.Connection]:
    """Open a database that is not changed meanwhile, and check its schema.

    Args:
        path: the file, without links.
        tables: what will be read; each that exists must be a table.

    Raises:
        RefusedDataError: it contains more than plain tables.
        sqlite3.Error: it is damaged.
    """
    # It may be on a read-only disk, where no lock file can be made.
    connection = sqlite3.connect(f"{path.as_uri()}?mode=ro&immutable=1", uri=True)
    try:
        restrict(connection)
        check_schema(connection, tables)
        end_deadline(connection)
        yield connection
    finally:
        connection.close()


def restrict(connection: sqlite3.Connection, max_s: float = MAX_SCHEMA_S) -> None:
    """Let a connection run nothing that a foreign schema brings, and no query without end.

    The time counts from this call, and until `end_deadline`.
    """
    end = time.monotonic() + max_s
    connection.set_progress_handler(lambda: time.monotonic() > end, STEPS_BETWEEN_CALLS)
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.execute("PRAGMA cell_size_check = ON")
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_VALUE_BYTES)


def end_deadline(connection: sqlite3.Connection) -> None:
    """Let queries of plain tables, which come to an end, take the time that their size needs.

    Python handles signals in the handler, so that a long query can still be interrupted.
    """
    connection.set_progress_handler(lambda: False, STEPS_BETWEEN_CALLS)


def check_schema(connection: sqlite3.Connection, tables: Collection[str]) -> None:
    """See that a database consists of tables and indexes only.

    Raises:
        RefusedDataError: it does not.
        sqlite3.Error: the database is damaged.
    """
    rows = connection.execute(
        "SELECT type, name, sql FROM sqlite_master LIMIT ?", (MAX_SCHEMA_OBJECTS + 1,)
    ).fetchall()
    if len(rows) > MAX_SCHEMA_OBJECTS:
        raise RefusedDataError(f"it has more than {MAX_SCHEMA_OBJECTS:,} tables", hint=_HINT)
    table_names = {name.lower() for name in tables}
    for kind, name, sql in rows:
        if kind not in ("table", "index"):
            what = kind if kind in ("view", "trigger") else "part that is no table"
            raise RefusedDataError(f"it contains a {what}", hint=_HINT)
        if _VIRTUAL.match(sql or ""):
            raise RefusedDataError("it contains a virtual table", hint=_HINT)
        if kind == "table" and str(name).lower() in table_names:
            columns = connection.execute("SELECT hidden FROM pragma_table_xinfo(?)", (name,))
            if any(hidden in _GENERATED for (hidden,) in columns):
                raise RefusedDataError(f"its table {name!r} has a generated column", hint=_HINT)
