"""Reading and writing a history. Several programs may do so at once."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeVar

from r2bspec.compare.history.errors import HistoryError
from r2bspec.compare.history.migrations import (
    APPLICATION_ID,
    SCHEMA_VERSION,
    migrate,
    schema_version,
)
from r2bspec.compare.history.model import HistoryEntry, HistoryMetric
from r2bspec.untrusted.errors import RefusedDataError
from r2bspec.untrusted.safe_sqlite import check_schema, end_deadline, restrict

T = TypeVar("T")

_MAX_LOCK_WAIT_S: Final = 30.0
"""How long to wait for another program that is writing. A row takes milliseconds."""

_MAX_OPENING_S: Final = 120.0
_TABLES: Final = ("runs", "metrics")

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
        """Remember a run; one of the same id is replaced.

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
        """The latest runs that a new one may be compared with, oldest first, with their metrics.

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
        """What is remembered of one run.

        Raises:
            HistoryError: the file cannot be read.
        """
        with _translate_errors(self.path):
            rows = self._connection.execute(
                "SELECT at_hz, monitor, metric, unit, value FROM metrics WHERE run_id = ? "
                "ORDER BY rowid",
                (run_id,),
            ).fetchall()
        names = ("at_hz", "monitor", "metric", "unit", "value")
        return tuple(self._typed(HistoryMetric, dict(zip(names, row, strict=True))) for row in rows)

    def accept(self, run_id: str) -> bool:
        """Let a run count as a baseline although it failed; whether there is such a run.

        Raises:
            HistoryError: the file cannot be written.
        """
        with _translate_errors(self.path), self._transaction():
            done = self._connection.execute(
                "UPDATE runs SET accepted = 1 WHERE run_id = ?", (run_id,)
            )
        return bool(done.rowcount)

    def remove(self, run_ids: Sequence[str]) -> int:
        """Forget runs; how many there were.

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
        return tuple(
            self._typed(HistoryEntry, one | {"accepted": bool(one["accepted"])}) for one in found
        )

    def _typed(self, kind: type[T], row: dict[str, Any]) -> T:
        """A row as a value; a table that was changed may have columns of other types."""
        import msgspec

        try:
            return msgspec.convert(row, kind)
        except msgspec.ValidationError as error:
            raise HistoryError(
                f"the history {self.path} is damaged, or no history: {error}",
                hint="Put it aside and begin a new one; run folders can be judged without it.",
            ) from error

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
    """Open a history, and bring it to this version's tables.

    Args:
        path: the file.
        create: make it, and its folders, if it is not there.

    Raises:
        HistoryError: it is not there, is no history, is damaged, was written by a newer version,
            or another program holds it for too long.
    """
    if not path.exists() and not create:
        raise HistoryError(
            f"there is no history {path}",
            hint=f"'r2bspec run SPEC --history {path}' begins one.",
        )
    with contextlib.ExitStack() as stack:
        with _translate_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            connection = sqlite3.connect(path, timeout=_MAX_LOCK_WAIT_S, isolation_level=None)
            stack.enter_context(contextlib.closing(connection))
            restrict(connection, _MAX_OPENING_S)
            _check(path, connection)
            # Readers and a writer do not wait for each other; the file says so from then on.
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA foreign_keys = ON")
            migrate(connection)
            end_deadline(connection)
        yield History(path, connection)


def _check(path: Path, connection: sqlite3.Connection) -> None:
    """See that the file is a history that this version knows, before anything is changed."""
    application = int(connection.execute("PRAGMA application_id").fetchone()[0])
    tables = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    if application != APPLICATION_ID and tables:
        raise HistoryError(
            f"{path} is a database of another program, not a history of r2bspec",
            hint="Name another file with --history.",
        )
    check_schema(connection, _TABLES)
    version = schema_version(connection)
    if version > SCHEMA_VERSION:
        raise HistoryError(
            f"{path} has version {version}; this r2bspec knows versions up to {SCHEMA_VERSION}",
            hint="Use the r2bspec that wrote it, or a newer one.",
        )


@contextlib.contextmanager
def _translate_errors(path: Path) -> Iterator[None]:
    """What SQLite or the file system refuses, as an error with a way out."""
    try:
        yield
    except RefusedDataError as error:
        raise HistoryError(
            f"the history {path} was not written by r2bspec: {error}",
            hint="Put it aside and begin a new one; run folders can be judged without it.",
        ) from error
    except sqlite3.OperationalError as error:
        busy = "locked" in str(error) or "busy" in str(error)
        hint = "Another program holds it; try again." if busy else "See that it can be written."
        raise HistoryError(f"the history {path} cannot be used: {error}", hint=hint) from error
    except sqlite3.Error as error:
        raise HistoryError(
            f"the history {path} is damaged, or no history: {error}",
            hint="Put it aside and begin a new one; run folders can be judged without it.",
        ) from error
    except OSError as error:
        raise HistoryError(
            f"the history {path} cannot be used: {error.strerror or error}",
            hint="Name another file with --history.",
        ) from error
