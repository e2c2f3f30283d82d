"""Databases from outside: plain tables, read-only, and queries that end."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from r2bspec.safe_io.safe_file import RefusedDataError
from r2bspec.safe_io.safe_sqlite import end_deadline, open_read_only, restrict

ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"


def _database(file: Path, statements: str) -> Path:
    connection = sqlite3.connect(file)
    connection.executescript(f"BEGIN; {statements}; COMMIT")
    connection.close()
    return file


def test_plain_tables_are_read_and_not_written(tmp_path: Path) -> None:
    file = _database(
        tmp_path / "a",
        "CREATE TABLE t(i INTEGER PRIMARY KEY AUTOINCREMENT, d UNIQUE); "
        "INSERT INTO t(d) VALUES (7); CREATE TABLE other(i); CREATE INDEX by_d ON t(d); ANALYZE",
    )
    with open_read_only(file, tables=("t", "none")) as connection:
        assert connection.execute("SELECT d FROM t").fetchall() == [(7,)]
        with pytest.raises(sqlite3.OperationalError, match="readonly"):
            connection.execute("DELETE FROM t")


@pytest.mark.parametrize(
    ("statements", "reason"),
    [
        ("CREATE VIEW v AS ENDLESS SELECT i FROM n", "contains a view"),
        ("CREATE TRIGGER g AFTER INSERT ON t BEGIN DELETE FROM t; END", "contains a trigger"),
        ("CREATE VIRTUAL TABLE v USING fts4(a)", "contains a virtual table"),
        ("CREATE TABLE T2(a, b AS (zeroblob(1)) STORED)", "'T2' has a generated column"),
        ("CREATE TABLE t2(a, b GENERATED ALWAYS AS (1))", "'t2' has a generated column"),
        (";".join(f"CREATE TABLE a{i}(i)" for i in range(1001)), "more than 1,000 tables"),
    ],
)
def test_a_schema_with_more_than_tables_is_refused(
    statements: str, reason: str, tmp_path: Path
) -> None:
    file = _database(tmp_path / "a", f"CREATE TABLE t(i); {statements}".replace("ENDLESS", ENDLESS))
    with pytest.raises(RefusedDataError, match=reason), open_read_only(file, tables=("t", "t2")):
        pass


def test_a_query_without_end_is_ended_by_the_deadline() -> None:
    connection = sqlite3.connect(":memory:")
    restrict(connection, 0.0)
    with pytest.raises(sqlite3.OperationalError, match="interrupted"):
        connection.execute("ENDLESS SELECT count(*) FROM n".replace("ENDLESS", ENDLESS)).fetchall()
    end_deadline(connection)
    rows = "ENDLESS SELECT count(*) FROM (SELECT i FROM n LIMIT 200000)".replace("ENDLESS", ENDLESS)
    assert connection.execute(rows).fetchall() == [(200_000,)]
    connection.close()


def test_a_file_that_is_no_database_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"x" * 5000)
    with pytest.raises(sqlite3.DatabaseError), open_read_only(tmp_path / "a", tables=()):
        pass
