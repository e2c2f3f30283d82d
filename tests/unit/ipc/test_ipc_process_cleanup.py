"""Promise: whatever a run has started, and whatever that has started, ends with the run."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import pytest

from family_trees import Family, family, wait_for
from r2bspec.execute.processes.process import ManagedProcess
from r2bspec.ipc.process_cleanup import (
    ProcessSession,
    SessionLeader,
    clean_up,
    end_run_processes,
    kill_process_groups,
    now_ticks,
    run_processes,
    start_ticks,
)
from r2bspec.middleware import fast_dds


@pytest.mark.parametrize(
    ("kind", "count"),
    [
        ("parent-of-parent-of-plain", 3),
        ("gone-parent-of-plain", 1),
        ("parent-of-stranger", 2),
        ("gone-parent-of-stranger", 1),
        ("parent-of-nameless", 2),
    ],
)
def test_every_descendant_is_found_and_ended(people: Family, kind: str, count: int) -> None:
    pids = people.start(kind, count)
    assert {process.pid for process in run_processes(people.run_id, people.sessions)} >= set(pids)
    assert end_run_processes(people.run_id, people.sessions, grace_s=30.0) == []
    assert people.living() == []
    assert run_processes(people.run_id, people.sessions) == []


@pytest.mark.parametrize("kind", ["stubborn", "parent-of-stubborn", "parent-of-stubborn-stranger"])
def test_what_ignores_polite_signals_is_killed_and_named(people: Family, kind: str) -> None:
    people.start(kind, kind.count("-of-") + 1)
    killed = end_run_processes(people.run_id, people.sessions, grace_s=0.2)
    assert len(killed) >= 1
    assert all(name.startswith("python") for name in killed)
    assert people.living() == []


def test_other_runs_are_left_alone(tmp_path: Path, people: Family) -> None:
    with family(tmp_path / "others", "another") as others:
        theirs = others.start("parent-of-stranger", 2)
        people.start("plain")
        end_run_processes(people.run_id, people.sessions, grace_s=30.0)
        assert people.living() == []
        assert others.living() == sorted(theirs)


@pytest.mark.parametrize("kind", ["plain", "parent-of-nameless", "gone-parent-of-nameless"])
def test_a_session_that_was_opened_after_the_runs_own_was_gone_is_left_alone(
    people: Family, kind: str
) -> None:
    pids = people.start(kind, 2 if kind.startswith("parent") else 1)
    people.collect()
    (later,) = people.sessions
    # The run once had a session of this number; its first process was collected before.
    before = ProcessSession(later.pid, started=later.started - 2, held=later.started - 1)
    assert run_processes("a run of long ago", [before]) == []
    assert end_run_processes("a run of long ago", [before], grace_s=0.1) == []
    kill_process_groups([before])
    assert people.living() == sorted(pids)


def test_who_was_there_before_the_first_process_was_collected_is_of_the_run(
    people: Family,
) -> None:
    (pid,) = people.start("gone-parent-of-nameless")
    # Clock ticks are coarse.
    wait_for(lambda: now_ticks() > (start_ticks(pid) or 0) + 1)
    people.collect()
    (session,) = people.sessions
    assert session.held is not None
    assert start_ticks(session.pid) is None
    assert [run_process.pid for run_process in run_processes("", [session])] == [pid]


def test_the_group_of_a_process_that_was_collected_is_not_signalled(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    process = SessionLeader([sys.executable, "-c", ""])
    process.wait(60.0)
    monkeypatch.setattr(os, "killpg", lambda *_: pytest.fail("its number may be another's"))
    ManagedProcess("node", "host", process, tmp_path / "log", None).signal(signal.SIGKILL)


def test_one_that_may_not_be_looked_at_is_passed_over(
    monkeypatch: pytest.MonkeyPatch, people: Family
) -> None:
    people.start("plain")

    def refuse(_environment: Path) -> bytes:
        raise PermissionError

    monkeypatch.setattr(Path, "read_bytes", refuse)
    assert run_processes(people.run_id, []) == []
    assert len(run_processes(people.run_id, people.sessions)) == 1


@pytest.mark.parametrize(
    ("rmw", "left"),
    [
        ("", set()),
        ("rmw_fastrtps_dynamic_cpp", set()),
        ("rmw_cyclonedds_cpp", {"fastrtps_0123", "fastrtps_0123_el"}),
    ],
)
def test_what_the_runs_middleware_left_in_shared_memory_is_removed(
    tmp_path: Path, run_id: str, monkeypatch: pytest.MonkeyPatch, rmw: str, left: set[str]
) -> None:
    for name in ("fastrtps_0123", "fastrtps_0123_el"):
        (tmp_path / name).touch()
    remove = fast_dds.MIDDLEWARE.remove_dead_shm_files

    def elsewhere(since_s: float) -> list[str]:
        return remove(tmp_path, since_s=since_s)

    monkeypatch.setattr(fast_dds.MIDDLEWARE, "remove_dead_shm_files", elsewhere)
    monkeypatch.setenv("RMW_IMPLEMENTATION", rmw)
    assert clean_up(run_id, (), grace_s=0.1, since_s=0.0) == []
    assert {each.name for each in tmp_path.iterdir()} == left
