"""Reading and writing a history. Several programs may do so at once."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from r2bspec.compare.history.errors import HistoryError
from r2bspec.compare.history.migrations import (
    APPLICATION_ID,
    SCHEMA_VERSION,
    migrate,
    schema_version,
)
from r2bspec.compare.history.model import HistoryEntry, HistoryMetric

_MAX_LOCK_WAIT_S: Final = 30.0
"""How long to wait for another program that is writing. A row takes milliseconds."""

_COLUMNS: Final = (
    *("run_id", "name", "started_at", "host", "machine", "plan", "dataset", "version"),
    *("outcome", "accepted"),
)


def user_history() -> Path:
    """Where a user's own history is kept on this system."""
    import platformdirs

    return platformdirs.user_data_path("r2bspec") / "history.sqlite"


class History:
    """An open history; see `open_history`."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection

    def add(self, entry: HistoryEntry) -> None:
        """Store a run; one with the same id is replaced.

        Raises:
            HistoryError: the file cannot be written.
        """
        values = [getattr(entry, name) for name in _COLUMNS]
        marks = ", ".join("?" for _ in _COLUMNS)
        with _translate_errors(self.path), self._transaction():
            self._connection.execute("DELETE FROM runs WHERE run_id = ?", (entry.run_id,))
            self._connection.execute(
                f"INSERT INTO runs ({', '.join(_COLUMNS)}) VALUES ({marks})",  # noqa: S608 - ours
                values,
            )
            self._connection.executemany(
                "INSERT INTO metrics (run_id, at_hz, monitor, metric, unit, value) "
                "VALUES (?, ?, ?, ?, ?, ?)",
                [
                    (entry.run_id, one.at_hz, one.monitor, one.metric, one.unit, one.value)
                    for one in entry.metrics
                ],
            )

    def runs(self, *, name: str = "") -> tuple[HistoryEntry, ...]:
        """All runs, or those of one benchmark, oldest first, without their metrics.

        Raises:
            HistoryError: the file cannot be read.
        """
        where, values = ("WHERE name = ?", (name,)) if name else ("", ())
        return self._entries(where, values)

    def comparable_runs(
        self, host: str, plan: str, dataset: str, max_runs: int
    ) -> tuple[HistoryEntry, ...]:
        """The latest runs that a new run may be compared with, oldest first, with their metrics.

        They are of the same plan and data on the same kind of machine. Runs that failed are left
        out unless they were accepted: a regression must not become the baseline of the next run.

        Raises:
            HistoryError: the file cannot be read.
        """
        found = self._entries(
            "WHERE host = ? AND plan = ? AND dataset = ? AND (outcome != 'fail' OR accepted)",
            (host, plan, dataset),
        )[-max_runs:]
        return tuple(replace(one, metrics=self.metrics(one.run_id)) for one in found)

    def metrics(self, run_id: str) -> tuple[HistoryMetric, ...]:
        """The stored metrics of one run.

        Raises:
            HistoryError: the file cannot be read.
        """
        with _translate_errors(self.path):
            rows = self._connection.execute(
                "SELECT at_hz, monitor, metric, unit, value FROM metrics WHERE run_id = ? "
                "ORDER BY rowid",
                (run_id,),
            ).fetchall()
        return tuple(
            HistoryMetric(at_hz=at_hz, monitor=monitor, metric=metric, unit=unit, value=value)
            for at_hz, monitor, metric, unit, value in rows
        )

    def accept(self, run_id: str) -> bool:
        """Let a run count as a baseline although it failed; returns whether the run exists.

        Raises:
            HistoryError: the file cannot be written.
        """
        with _translate_errors(self.path), self._transaction():
            done = self._connection.execute(
                "UPDATE runs SET accepted = 1 WHERE run_id = ?", (run_id,)
            )
        return bool(done.rowcount)

    def remove(self, run_ids: Sequence[str]) -> int:
        """Delete runs; returns how many there were.

        Raises:
            HistoryError: the file cannot be written.
        """
        with _translate_errors(self.path), self._transaction():
            done = self._connection.executemany(
                "DELETE FROM runs WHERE run_id = ?", [(one,) for one in run_ids]
            )
        return done.rowcount

    def _entries(self, where: str, values: Sequence[Any]) -> tuple[HistoryEntry, ...]:
        columns = ", ".join(_COLUMNS)
        with _translate_errors(self.path):
            rows = self._connection.execute(
                f"SELECT {columns} FROM runs {where} ORDER BY started_at, rowid",  # noqa: S608
                values,
            ).fetchall()
        found = (dict(zip(_COLUMNS, row, strict=True)) for row in rows)
        return tuple(HistoryEntry(**one | {"accepted": bool(one["accepted"])}) for one in found)

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        # IMMEDIATE waits for the lock at once; a read that later wants to write would not wait.
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            self._connection.execute("ROLLBACK")
            raise
        self._connection.execute("COMMIT")


@contextlib.contextmanager
def open_history(path: Path, *, create: bool = False) -> Iterator[History]:
    """Open a history, and migrate it to this version.

    Args:
        path: the file.
        create: create it, and its folders, if it does not exist.

    Raises:
        HistoryError: it does not exist, is not a history, is damaged, was written by a newer
            version, or is locked by another program for too long.
    """
    if not path.exists() and not create:
        raise HistoryError(
            f"the history {path} does not exist",
            hint=f"'r2bspec run SPEC --history {path}' creates it.",
        )
    with contextlib.ExitStack() as stack:
        with _translate_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            connection = sqlite3.connect(path, timeout=_MAX_LOCK_WAIT_S, isolation_level=None)
            stack.enter_context(contextlib.closing(connection))
            _check(path, connection)
            # Readers and a writer do not wait for each other; the file says so from then on.
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA foreign_keys = ON")
            migrate(connection)
        yield History(path, connection)


def _check(path: Path, connection: sqlite3.Connection) -> None:
    """Check that the file is a history of a known version, before anything is changed."""
    application = int(connection.execute("PRAGMA application_id").fetchone()[0])
    tables = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    if application != APPLICATION_ID and tables:
        raise HistoryError(
            f"{path} is a database of another program, not a history of r2bspec",
            hint="Name another file with --history.",
        )
    version = schema_version(connection)
    if version > SCHEMA_VERSION:
        raise HistoryError(
            f"{path} has version {version}; this r2bspec supports versions up to {SCHEMA_VERSION}",
            hint="Use the r2bspec that wrote it, or a newer one.",
        )


@contextlib.contextmanager
def _translate_errors(path: Path) -> Iterator[None]:
    """Errors of SQLite or the file system as a `HistoryError` with a hint."""
    try:
        yield
    except sqlite3.OperationalError as error:
        busy = "locked" in str(error) or "busy" in str(error)
        hint = "Another program uses it; try again." if busy else "Check that it is writable."
        raise HistoryError(f"the history {path} cannot be used: {error}", hint=hint) from error
    except sqlite3.Error as error:
        raise HistoryError(
            f"the history {path} is damaged, or not a history: {error}",
            hint="Move it away and start a new one; run folders can be judged without it.",
        ) from error
    except OSError as error:
        raise HistoryError(
            f"the history {path} cannot be used: {error.strerror or error}",
            hint="Name another file with --history.",
        ) from error
