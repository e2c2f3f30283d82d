"""The history of runs: what it keeps, what it refuses, and two programs that write at once."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import sqlite3
from multiprocessing.synchronize import Barrier
from pathlib import Path
from typing import Any

import pytest

from nightly import size
from r2bspec.compare.history import (
    SCHEMA_VERSION,
    History,
    HistoryEntry,
    HistoryError,
    HistoryMetric,
    open_history,
)


def entry(run_id: str, *, outcome: str = "pass", day: int = 1, plan: str = "plan") -> HistoryEntry:
    return HistoryEntry(
        run_id=run_id,
        name="relay",
        started_at=f"2026-01-{day:02d}T00:00:00+00:00",
        host="host",
        machine="a machine",
        plan=plan,
        dataset="data",
        version="0.1.0",
        outcome=outcome,
        metrics=(
            HistoryMetric(at_hz=30.0, monitor="out", metric="latency.p50", unit="s", value=0.02),
            HistoryMetric(at_hz=None, monitor=None, metric="peak.rate", unit="Hz", value=None),
        ),
    )


def written(folder: Path, *entries: HistoryEntry) -> Path:
    """A history of these runs."""
    path = folder / "h"
    with open_history(path, create=True) as history:
        for run in entries:
            history.add(run)
    return path


def query(path: Path, *statements: str) -> list[tuple[Any, ...]]:
    """Carry out statements as another program would; the rows of the last one."""
    with contextlib.closing(sqlite3.connect(path)) as connection:
        for statement in statements:
            rows = connection.execute(statement).fetchall()
        return rows


def refusal(path: Path, match: str | None = None, *, create: bool = False) -> HistoryError:
    """The error that a file is no history that can be read."""
    with (
        pytest.raises(HistoryError, match=match) as caught,
        open_history(path, create=create) as history,
    ):
        history.comparable_runs("host", "plan", "data", 30)
    return caught.value


def comparable(
    history: History, most: int = 30, host: str = "host", data: str = "data"
) -> list[str]:
    """The runs that a new one may be compared with."""
    return [run.run_id for run in history.comparable_runs(host, "plan", data, most)]


def test_what_is_added_is_found_again(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "history.sqlite"
    with open_history(path, create=True) as history:
        history.add(entry("b", day=2))
        history.add(entry("a", day=1))
        history.add(entry("b", day=2))
    with open_history(path) as history:
        assert [run.run_id for run in history.runs()] == ["a", "b"]
        assert history.runs(name="another") == ()
        found = history.comparable_runs("host", "plan", "data", 30)
        assert [one.metrics for one in found] == [entry("a").metrics] * 2


def test_only_runs_alike_are_compared_and_only_the_latest(tmp_path: Path) -> None:
    with open_history(tmp_path / "h", create=True) as history:
        for day in range(1, 8):
            history.add(entry(f"run{day}", day=day))
        history.add(entry("elsewhere", plan="another", day=9))
        assert comparable(history, 3) == ["run5", "run6", "run7"]
        assert comparable(history, data="other data") == comparable(history, host="other") == []


def test_a_failed_run_is_no_baseline_until_it_is_accepted(tmp_path: Path) -> None:
    with open_history(tmp_path / "h", create=True) as history:
        history.add(entry("good"))
        history.add(entry("bad", outcome="fail", day=2))
        assert comparable(history) == ["good"]
        assert history.accept("bad")
        assert not history.accept("nobody")
        assert comparable(history) == ["good", "bad"]


def test_forgetting_a_run_forgets_its_metrics(tmp_path: Path) -> None:
    path = written(tmp_path, entry("a"), entry("b"))
    with open_history(path) as history:
        assert history.remove(["a", "nobody"]) == 1
        assert history.metrics("a") == ()
    assert query(path, "SELECT count(*) FROM metrics") == [(2,)]


@pytest.mark.parametrize("version", [SCHEMA_VERSION - 1, SCHEMA_VERSION + 1])
def test_another_version_is_refused_and_left_alone(tmp_path: Path, version: int) -> None:
    path = written(tmp_path, entry("a"))
    query(path, f"PRAGMA user_version = {version}")
    before = path.read_bytes()
    refusal(path, rf"has version {version}; this r2bspec reads version {SCHEMA_VERSION}$")
    assert path.read_bytes() == before


@pytest.mark.parametrize("content", [b"x" * 4096, b"SQLite format 3\x00" + b"\xff" * 4080])
def test_a_damaged_file_is_said(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "h"
    path.write_bytes(content)
    assert refusal(path, "cannot be used|damaged").hint


def test_a_file_cut_short_is_said(tmp_path: Path) -> None:
    path = written(tmp_path, *(entry(f"run{number}") for number in range(200)))
    path.write_bytes(path.read_bytes()[:8192])
    for leftover in tmp_path.glob("h-*"):
        leftover.unlink()
    refusal(path)


def test_a_database_of_another_program_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "h"
    query(path, "CREATE TABLE runs (mine TEXT)")
    before = path.read_bytes()
    refusal(path, "another program")
    assert path.read_bytes() == before


def test_what_is_not_there_is_said(tmp_path: Path) -> None:
    refusal(tmp_path / "nothing", "does not exist")
    refusal(tmp_path, create=True)


def _write(folder: Path, name: str, barrier: Barrier, rounds: int) -> None:
    for number in range(rounds):
        barrier.wait(60)
        # Opened anew for every run.
        for run in range(3):
            with open_history(folder / str(number), create=True) as history:
                history.add(entry(f"{name}-{run}"))
                history.runs()


def test_many_programs_make_one_history_at_once(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    names, rounds = [f"w{number:02}" for number in range(size(4, 16))], size(3, 10)
    barrier = context.Barrier(len(names))
    programs = [
        context.Process(target=_write, args=(tmp_path, name, barrier, rounds)) for name in names
    ]
    for program in programs:
        program.start()
    for program in programs:
        program.join(120)
    assert [program.exitcode for program in programs] == [0] * len(programs)
    written = [f"{name}-{run}" for name in names for run in range(3)]
    for number in range(rounds):
        with open_history(tmp_path / str(number)) as history:
            assert sorted(run.run_id for run in history.runs()) == written
        assert query(tmp_path / str(number), "PRAGMA journal_mode") == [("wal",)]


def test_no_other_user_may_read_a_new_history(tmp_path: Path) -> None:
    before = os.umask(0o022)
    try:
        file = tmp_path / "folder" / "history.sqlite"
        with open_history(file, create=True) as history:
            assert history.runs() == ()
            modes = {each.name: each.stat().st_mode & 0o777 for each in file.parent.iterdir()}
        assert os.umask(0o022) == 0o022, "the umask of the process is as it was"
    finally:
        os.umask(before)
    assert set(modes.values()) == {0o600}, modes
    assert "history.sqlite-wal" in modes
    assert file.parent.stat().st_mode & 0o777 == 0o700
