"""Runs of programs, and of pytest, have the lock of the host, too."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from lock_holder import other_holder
from r2bspec import api
from r2bspec.execute.processes.machine import HostBusyError, lock_file
from r2bspec.execute.progress import Progress

ROOT = Path(__file__).parents[3]
RELAY = ROOT / "specs" / "relay.r2b.yaml"


class Notes(Progress):
    """What a run says."""

    def __init__(self, on_note: Callable[[], object] = lambda: None) -> None:
        self.texts: list[str] = []
        self._on_note = on_note

    def note(self, text: str) -> None:
        self.texts.append(text)
        self._on_note()


@pytest.fixture
def holder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[subprocess.Popen[str]]:
    """Another process that has the lock, of these tests alone, until its input is closed."""
    with other_holder(tmp_path, monkeypatch) as process:
        yield process


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the lock says while runs are made, of which none is: this is about the lock."""
    found: list[str] = []

    def make(*_: Any, **__: Any) -> None:
        found.append(lock_file().read_text())

    monkeypatch.setattr(api, "_run_in_folder", make)
    monkeypatch.setattr("r2bspec.compare.interleaved_runs.compare", make)
    return found


@pytest.fixture(scope="module")
def prepared() -> api.PreparedBenchmark:
    return api.prepare(RELAY)


def run(prepared: api.PreparedBenchmark, folder: Path, notes: Notes, **ways: Any) -> None:
    api.run(prepared, folder / "run", notes, **ways)


def run_pairs(prepared: api.PreparedBenchmark, folder: Path, notes: Notes, **ways: Any) -> None:
    api.run_pairs(prepared, (), folder / "pairs", notes, control=True, pairs=2, **ways)


@pytest.mark.parametrize("make", [run, run_pairs])
def test_a_run_waits_and_says_for_whom(
    make: Callable[..., None],
    prepared: api.PreparedBenchmark,
    holder: subprocess.Popen[str],
    played: list[str],
    tmp_path: Path,
) -> None:
    assert holder.stdin is not None
    notes = Notes(holder.stdin.close)
    make(prepared, tmp_path, notes)
    assert notes.texts == [
        f"waiting for the other one (process {holder.pid}), which runs on this host"
    ]
    assert [each.partition(" ")[2] for each in played] == [f"(process {os.getpid()})"]


@pytest.mark.parametrize("make", [run, run_pairs])
def test_a_run_that_is_not_to_wait_is_refused(
    make: Callable[..., None],
    prepared: api.PreparedBenchmark,
    holder: subprocess.Popen[str],
    played: list[str],
    tmp_path: Path,
) -> None:
    with pytest.raises(HostBusyError, match=f"the other one \\(process {holder.pid}\\)"):
        make(prepared, tmp_path, Notes(), lock="refuse")
    assert played == []
    assert {each.name for each in tmp_path.iterdir()} == {lock_file().name}


def test_a_run_without_the_lock_is_made_at_once(
    prepared: api.PreparedBenchmark,
    holder: subprocess.Popen[str],
    played: list[str],
    tmp_path: Path,
) -> None:
    notes = Notes()
    run(prepared, tmp_path, notes, lock="off")
    assert played == [f"the other one (process {holder.pid})"]
    assert notes.texts == []


def test_a_test_of_pytest_is_refused_with_its_option(
    holder: subprocess.Popen[str], tmp_path: Path
) -> None:
    (tmp_path / "relay.r2b.yaml").write_text(RELAY.read_text())
    environment = os.environ | {
        "PYTHONPATH": str(ROOT),
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        "TMPDIR": str(tmp_path),
    }
    done = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-p", "r2bspec.pytest_plugin"),
            *("--r2bspec", "--r2bspec-no-wait", "-k", "not valid"),
        ],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1, done.stdout
    assert f"R2B697: this host is in use by the other one (process {holder.pid})" in done.stdout
    assert not (tmp_path / "runs").exists()
