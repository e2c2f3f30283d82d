"""The tables of a history, version by version.

``PRAGMA user_version`` counts the migrations that a file has had. Each is a transaction of its own:
a file is always at one of the versions.
"""

from __future__ import annotations

import sqlite3
from typing import Final

APPLICATION_ID: Final = 0x52324253
"""'R2BS' in ASCII: distinguishes a history from the database of another program."""

MIGRATIONS: Final[tuple[tuple[str, ...], ...]] = (
    (
        """
        CREATE TABLE runs (
            run_id TEXT PRIMARY KEY,
            name TEXT NOT NULL,
            started_at TEXT NOT NULL,
            host TEXT NOT NULL,
            machine TEXT NOT NULL,
            plan TEXT NOT NULL,
            dataset TEXT NOT NULL,
            version TEXT NOT NULL,
            outcome TEXT NOT NULL
        ) STRICT
        """,
        """
        CREATE TABLE metrics (
            run_id TEXT NOT NULL REFERENCES runs (run_id) ON DELETE CASCADE,
            at_hz REAL,
            monitor TEXT,
            metric TEXT NOT NULL,
            unit TEXT NOT NULL,
            value REAL
        ) STRICT
        """,
        "CREATE INDEX metrics_of_run ON metrics (run_id)",
    ),
    # An intended regression: the run counts as a baseline although it failed.
    (
        "ALTER TABLE runs ADD COLUMN accepted INTEGER NOT NULL DEFAULT 0",
        "CREATE INDEX runs_alike ON runs (host, plan, started_at)",
    ),
)

SCHEMA_VERSION: Final = len(MIGRATIONS)


def schema_version(connection: sqlite3.Connection) -> int:
    """How many migrations a file has had."""
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def migrate(connection: sqlite3.Connection) -> None:
    """Bring a file, also an empty one, to the current version.

    Two programs that open an old file at once both get here; the second waits for the lock of the
    first and then has nothing left to do.

    Raises:
        sqlite3.Error: the file is damaged, locked, or not to be written.
    """
    while schema_version(connection) < SCHEMA_VERSION:
        connection.execute("BEGIN IMMEDIATE")
        try:
            done = schema_version(connection)
            for statement in MIGRATIONS[done] if done < SCHEMA_VERSION else ():
                connection.execute(statement)
            if done < SCHEMA_VERSION:
                connection.execute(f"PRAGMA user_version = {done + 1}")
                connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
            connection.execute("COMMIT")
        except BaseException:
            connection.execute("ROLLBACK")
            raise
