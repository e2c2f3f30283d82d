"""The tables of a history.

``PRAGMA user_version`` is the version of the format that a file has.
"""

from __future__ import annotations

import sqlite3
from typing import Final

APPLICATION_ID: Final = 0x52324253
"""'R2BS' in ASCII: distinguishes a history from the database of another program."""

SCHEMA_VERSION: Final = 3
"""Version 1 was never released. Version 2 has no identities."""

# A failed run counts as a baseline once it is accepted, as an intended regression.
_STATEMENTS: Final = (
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
        outcome TEXT NOT NULL,
        accepted INTEGER NOT NULL DEFAULT 0,
        identity TEXT NOT NULL DEFAULT ''
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
    "CREATE INDEX runs_alike ON runs (host, plan, started_at)",
    f"PRAGMA application_id = {APPLICATION_ID}",
    f"PRAGMA user_version = {SCHEMA_VERSION}",
)

_UPGRADES: Final = {2: ("ALTER TABLE runs ADD COLUMN identity TEXT NOT NULL DEFAULT ''",)}
"""The statements that turn each older version into the next one."""


def schema_version(connection: sqlite3.Connection) -> int:
    """The version of a file's format; 0 for a file without tables."""
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def is_upgradable(version: int) -> bool:
    """Whether a file of an older version can be brought up to date."""
    return version in _UPGRADES


def upgrade(connection: sqlite3.Connection) -> None:
    """Bring a file of an older version up to date, in the caller's transaction."""
    while (version := schema_version(connection)) in _UPGRADES:
        for statement in _UPGRADES[version]:
            connection.execute(statement)
        connection.execute(f"PRAGMA user_version = {version + 1}")


def create_tables(connection: sqlite3.Connection) -> None:
    """Create the tables in an empty file, in the caller's transaction."""
    for statement in _STATEMENTS:
        connection.execute(statement)
