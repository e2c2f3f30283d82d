"""Promise: what dead runs left is found and removed; what a living run uses is never touched."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from r2bspec.doctor.checkup import System
from r2bspec.doctor.leftovers import (
    abandoned_scratch,
    check_leftovers,
    clean,
    find_leftovers,
    find_runs,
)
from r2bspec.ipc.protocol import RUN_ID_VARIABLE

WATCHDOG = "r2bspec.harness.watchdog"


@pytest.fixture
def system(tmp_path: Path) -> System:
    made = System(
        proc=tmp_path / "proc",
        shared_memory=tmp_path / "shm",
        runs=tmp_path / "runs",
        environ={},
    )
    for folder in (made.proc, made.shared_memory, made.runs):
        folder.mkdir()
    return made


def process(
    system: System,
    pid: int,
    *argv: str,
    parent: int = 1,
    state: str = "S",
    name: str = "python3",
    run_id: str = "",
    session: int = 0,
    started: int = 1000,
) -> None:
    """Show a process the way /proc does."""
    folder = system.proc / str(pid)
    folder.mkdir()
    (folder / "stat").write_text(
        f"{pid} ({name}) {state} {parent} {pid} {session or pid} 0 -1 4194304 "
        f"1 0 0 0 0 0 0 0 20 0 1 0 {started}\n"
    )
    (folder / "cmdline").write_bytes("\0".join([*argv, ""]).encode())
    variables = ["PATH=/bin", *([f"{RUN_ID_VARIABLE}={run_id}"] if run_id else [])]
    (folder / "environ").write_bytes("\0".join([*variables, ""]).encode())


def watchdog(system: System, pid: int, run_id: str, parent: int = 1) -> None:
    process(system, pid, "python3", "-P", "-m", WATCHDOG, run_id, "scratch", parent=parent)


def orphans(system: System) -> list[int]:
    return [orphan.pid for orphan in find_runs(system)[1]]


def test_a_run_with_its_watchdog_lives(system: System) -> None:
    process(system, 100, "r2bspec", "run", name="r2bspec")
    watchdog(system, 101, "run-1", parent=100)
    process(system, 102, "player", parent=100, run_id="run-1")
    assert find_runs(system)[0] == {"run-1"}
    assert orphans(system) == []


def test_processes_whose_controller_and_watchdog_are_gone_are_orphans(system: System) -> None:
    process(system, 1, "/sbin/init", name="init", parent=0)
    process(system, 200, "player", run_id="dead")
    process(system, 201, "grandchild", parent=200, run_id="dead")
    process(system, 300, "bash", name="bash")
    assert orphans(system) == [200, 201]


def test_a_run_whose_watchdog_was_killed_lives_as_long_as_its_controller(system: System) -> None:
    process(system, 100, "python3", "-m", "r2bspec", "run")
    process(system, 102, "player", parent=100, run_id="run-1")
    process(system, 103, "grandchild", parent=102, run_id="run-1")
    assert orphans(system) == []


def test_processes_of_another_user_are_not_ours_to_end(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    process(system, 102, "player", run_id="dead")
    assert orphans(system) == [102]
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    assert orphans(system) == []


def segment(system: System, name: str, *, lock: bool = True) -> None:
    (system.shared_memory / name).write_bytes(bytes(8192))
    if lock:
        (system.shared_memory / f"{name}_el").touch()


def scratch(system: System, run_id: str, *, age_s: float = 60.0) -> Path:
    folder = system.runs / f"folder-of-{run_id}"
    made = folder / ".scratch-abc"
    made.mkdir(parents=True)
    (folder / "record.json").write_text(json.dumps({"run_id": run_id}))
    old = time.time() - age_s
    os.utime(made, (old, old))
    return made


def test_scratch_that_was_just_made_may_belong_to_a_run_that_is_starting(system: System) -> None:
    scratch(system, "new", age_s=0.0)
    assert abandoned_scratch(system, set()) == []


def test_leftovers_are_told_with_the_way_to_remove_them(system: System) -> None:
    for number in range(5):
        process(system, 200 + number, "node", run_id="dead")
    segment(system, "fastrtps_dead")
    scratch(system, "dead")
    checks = {check.name: check for check in check_leftovers(system)}
    assert {name: check.status for name, check in checks.items()} == {
        "in progress": "ok",
        "lost processes": "problem",
        "dead segments": "warn",
        "scratch folders": "warn",
    }
    assert "and 2 more" in checks["lost processes"].found
    assert all("--clean" in c.advice for c in checks.values() if c.status != "ok")


def test_cleaning_ends_orphans_and_removes_what_they_left(system: System, tmp_path: Path) -> None:
    segment(system, "fastrtps_dead")
    dead = scratch(system, "dead")
    alive = scratch(system, "alive")
    run_id = f"test-doctor-{os.getpid()}"
    with subprocess.Popen(
        [sys.executable, "-c", "import time; time.sleep(600)"],
        env=os.environ | {RUN_ID_VARIABLE: run_id},
        start_new_session=True,
    ) as sleeper:
        # Shown as one whose controller is gone; ending it is done on the real process.
        process(system, sleeper.pid, "node", run_id=run_id)
        watchdog(system, 5, "alive")
        removed = clean(system)
        assert sleeper.wait(30.0) != 0
    assert f"process {sleeper.pid} (python3) of run {run_id}" in removed
    assert f"folder {dead}" in removed
    assert "segment fastrtps_dead" in removed
    assert len(removed) == 3
    assert alive.is_dir()
    (system.proc / str(sleeper.pid) / "stat").unlink()
    assert find_leftovers(system).orphans == ()
    assert clean(system) == []
