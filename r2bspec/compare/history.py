"""A history of runs in one SQLite file, used by `run --history`; several programs may share it.

``PRAGMA user_version`` is the version of the format that a file has.
"""

from __future__ import annotations

import contextlib
import sqlite3
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final, Literal, TypeVar

import msgspec

from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.safe_io.private_files import private_files
from r2bspec.safe_io.safe_file import RefusedDataError, is_there
from r2bspec.safe_io.safe_sqlite import check_schema, end_deadline, restrict


class HistoryError(R2bspecError):
    """A history that cannot be read or written: damaged, of a newer version, or locked."""

    code = "R2B654"
    exit_code = ExitStatus.USAGE


@dataclass(frozen=True, kw_only=True)
class HistoryMetric:
    """A metric of a whole run: the mean of its iterations, in its SI unit.

    Attributes:
        at_hz: the offered rate; None for the whole run.
        monitor: None for a metric without one.
        value: None where an iteration had none.
    """

    at_hz: float | None
    monitor: str | None
    metric: str
    unit: str
    value: float | None


@dataclass(frozen=True, kw_only=True)
class HistoryEntry:
    """One run.

    Attributes:
        host: fingerprint of the kind of machine (`r2bspec.record.graph_identity`).
        machine: a description of it.
        plan: hash of what was measured (`r2bspec.plan.comparability.measured_hash`).
        dataset: hash of the recorded data.
        outcome: of the verdict. A run that failed is no baseline for the next, unless `accepted`.
        started_at: ISO 8601, UTC.
        identity: what the graph was made of: `GraphIdentity` as JSON; empty if not known. Runs of
            other code are what a run is compared with, so that it does not select them.
    """

    run_id: str
    name: str
    started_at: str
    host: str
    machine: str
    plan: str
    dataset: str
    version: str
    outcome: str
    accepted: bool = False
    identity: str = ""
    metrics: tuple[HistoryMetric, ...] = ()


APPLICATION_ID: Final = 0x52324253
"""'R2BS' in ASCII: distinguishes a history from the database of another program."""

SCHEMA_VERSION: Final = 3

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

T = TypeVar("T")

_MAX_LOCK_WAIT_S: Final = 30.0
"""How long to wait for another program that is writing. A row takes milliseconds."""

_LOCK_POLL_S: Final = 0.01
_MAX_OPENING_S: Final = 120.0
_TABLES: Final = ("runs", "metrics")

_COLUMNS: Final = tuple(each.name for each in fields(HistoryEntry) if each.name != "metrics")
_METRIC_COLUMNS: Final = tuple(each.name for each in fields(HistoryMetric))


def _insertion(table: str, columns: Sequence[str]) -> str:
    """The statement that adds a row to one of our tables."""
    marks = ", ".join("?" * len(columns))
    return f"INSERT INTO {table} ({', '.join(columns)}) VALUES ({marks})"  # noqa: S608 - ours


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
        run = [getattr(entry, name) for name in _COLUMNS]
        metrics = [
            (entry.run_id, *(getattr(metric, name) for name in _METRIC_COLUMNS))
            for metric in entry.metrics
        ]
        with _translate_errors(self.path), _transaction(self._connection):
            self._connection.execute("DELETE FROM runs WHERE run_id = ?", (entry.run_id,))
            self._connection.execute(_insertion("runs", _COLUMNS), run)
            self._connection.executemany(
                _insertion("metrics", ("run_id", *_METRIC_COLUMNS)), metrics
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
        entries = self._entries(
            "WHERE host = ? AND plan = ? AND dataset = ? AND (outcome != 'fail' OR accepted)",
            (host, plan, dataset),
        )[-max_runs:]
        return tuple(replace(entry, metrics=self.metrics(entry.run_id)) for entry in entries)

    def metrics(self, run_id: str) -> tuple[HistoryMetric, ...]:
        """The stored metrics of one run.

        Raises:
            HistoryError: the file cannot be read.
        """
        with _translate_errors(self.path):
            rows = self._connection.execute(
                f"SELECT {', '.join(_METRIC_COLUMNS)} FROM metrics "  # noqa: S608 - ours
                "WHERE run_id = ? ORDER BY rowid",
                (run_id,),
            ).fetchall()
        return tuple(
            self._typed(HistoryMetric, dict(zip(_METRIC_COLUMNS, row, strict=True))) for row in rows
        )

    def accept(self, run_id: str) -> bool:
        """Let a run count as a baseline although it failed; returns whether the run exists.

        Raises:
            HistoryError: the file cannot be written.
        """
        with _translate_errors(self.path), _transaction(self._connection):
            done = self._connection.execute(
                "UPDATE runs SET accepted = 1 WHERE run_id = ?", (run_id,)
            )
        return bool(done.rowcount)

    def remove(self, run_ids: Sequence[str]) -> int:
        """Delete runs; returns how many there were.

        Raises:
            HistoryError: the file cannot be written.
        """
        with _translate_errors(self.path), _transaction(self._connection):
            done = self._connection.executemany(
                "DELETE FROM runs WHERE run_id = ?", [(run_id,) for run_id in run_ids]
            )
        return done.rowcount

    def _entries(self, where: str, values: Sequence[Any]) -> tuple[HistoryEntry, ...]:
        columns = ", ".join(_COLUMNS)
        with _translate_errors(self.path):
            rows = self._connection.execute(
                f"SELECT {columns} FROM runs {where} ORDER BY started_at, rowid",  # noqa: S608
                values,
            ).fetchall()
        stored_rows = (dict(zip(_COLUMNS, row, strict=True)) for row in rows)
        return tuple(
            self._typed(HistoryEntry, stored_row | {"accepted": bool(stored_row["accepted"])})
            for stored_row in stored_rows
        )

    def _typed(self, kind: type[T], row: dict[str, Any]) -> T:
        """A row as a value; a table that was changed may have columns of other types."""
        try:
            return msgspec.convert(row, kind)
        except msgspec.ValidationError as error:
            raise HistoryError(
                f"the history {self.path} is damaged, or no history: {error}",
                hint="Put it aside and begin a new one; run folders can be judged without it.",
            ) from error


@contextlib.contextmanager
def open_history(path: Path, *, create: bool = False) -> Iterator[History]:
    """Open a history.

    Args:
        path: the file.
        create: create it, and its folders, if it does not exist.

    Raises:
        HistoryError: it does not exist, is not a history, is damaged, has another version of the
            format, or is locked by another program for too long.
    """
    if not is_there(path) and not create:
        raise HistoryError(
            f"the history {path} does not exist",
            hint=f"'r2bspec run SPEC --history {path}' creates it.",
        )
    with contextlib.ExitStack() as stack:
        # SQLite gives its journals the mode of the file, so that only its creation matters.
        with _translate_errors(path), private_files():
            path.parent.mkdir(parents=True, exist_ok=True)
            connection = sqlite3.connect(path, timeout=_MAX_LOCK_WAIT_S, isolation_level=None)
            stack.enter_context(contextlib.closing(connection))
            restrict(connection, _MAX_OPENING_S)
            with _transaction(connection, "DEFERRED"):
                is_empty = _is_empty(path, connection)
            if is_empty:
                with _transaction(connection):
                    # Unless another program has done it meanwhile.
                    if _is_empty(path, connection):
                        for statement in _STATEMENTS:
                            connection.execute(statement)
            _use_write_ahead_log(connection)
            connection.execute("PRAGMA foreign_keys = ON")
            end_deadline(connection)
        yield History(path, connection)


def _is_empty(path: Path, connection: sqlite3.Connection) -> bool:
    """Check that the file is a history that can be read, or empty, before anything is changed."""
    if not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
        return True
    if connection.execute("PRAGMA application_id").fetchone()[0] != APPLICATION_ID:
        raise HistoryError(
            f"{path} is a database of another program, not a history of r2bspec",
            hint="Name another file with --history.",
        )
    check_schema(connection, _TABLES)
    version = int(connection.execute("PRAGMA user_version").fetchone()[0])
    if version != SCHEMA_VERSION:
        raise HistoryError(
            f"{path} has version {version}; this r2bspec reads version {SCHEMA_VERSION}",
            hint="Use the r2bspec that wrote it, or name another file with --history.",
        )
    return False


def _use_write_ahead_log(connection: sqlite3.Connection) -> None:
    """Let readers and a writer not wait for each other; the file keeps the setting.

    The change needs exclusive access to the file, which SQLite's own waiting for a lock does not
    cover.
    """
    deadline = time.monotonic() + _MAX_LOCK_WAIT_S
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
        except sqlite3.OperationalError as error:
            busy = error.sqlite_errorcode & 0xFF == sqlite3.SQLITE_BUSY
            if not busy or time.monotonic() > deadline:
                raise
            time.sleep(_LOCK_POLL_S)
        else:
            return


@contextlib.contextmanager
def _transaction(
    connection: sqlite3.Connection, kind: Literal["IMMEDIATE", "DEFERRED"] = "IMMEDIATE"
) -> Iterator[None]:
    # IMMEDIATE waits for the lock at once; a read that later wants to write would not wait.
    connection.execute(f"BEGIN {kind}")
    try:
        yield
    except BaseException:
        connection.execute("ROLLBACK")
        raise
    connection.execute("COMMIT")


@contextlib.contextmanager
def _translate_errors(path: Path) -> Iterator[None]:
    """Errors of SQLite or the file system as a `HistoryError` with a hint."""
    try:
        yield
    except RefusedDataError as error:
        raise HistoryError(
            f"the history {path} was not written by r2bspec: {error}",
            hint="Put it aside and begin a new one; run folders can be judged without it.",
        ) from error
    except UnicodeEncodeError as error:
        # The command line passes bytes that are not UTF-8 as lone surrogates.
        raise HistoryError(
            f"the history {path} has no run or benchmark of that name: it is not UTF-8",
            hint="'r2bspec history list' lists the runs.",
        ) from error
    except sqlite3.OperationalError as error:
        busy = "locked" in str(error) or "busy" in str(error)
        hint = "Another program uses it; try again." if busy else "Check that it is writable."
        raise HistoryError(f"the history {path} cannot be used: {error}", hint=hint) from error
    except (sqlite3.Error, UnicodeDecodeError) as error:
        # SQLite does not check that texts are UTF-8, and Python finds that in `execute`.
        what = "a text in it is not UTF-8" if isinstance(error, UnicodeDecodeError) else error
        raise HistoryError(
            f"the history {path} is damaged, or not a history: {what}",
            hint="Move it away and start a new one; run folders can be judged without it.",
        ) from error
    except OSError as error:
        raise HistoryError(
            f"the history {path} cannot be used: {error.strerror or error}",
            hint="Name another file with --history.",
        ) from error
