"""Promise: a run whose controller is killed, however hard, is ended all the same."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from family_trees import Family, alive, family, wait_for


@pytest.fixture
def scratch(tmp_path: Path) -> Path:
    """A scratch folder with something in it."""
    folder = tmp_path / "scratch"
    (folder / "rows").mkdir(parents=True)
    (folder / "rows" / "playback").write_bytes(b"rows")
    return folder


@pytest.fixture
def events(tmp_path: Path) -> Path:
    """What the processes of a run write of their callbacks, in memory."""
    folder = tmp_path / "events"
    folder.mkdir()
    (folder / "rows").write_bytes(b"rows")
    return folder


@pytest.fixture
def watchdog(run_id: str, scratch: Path, events: Path) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, "-m", "r2bspec.harness.watchdog", run_id, str(scratch), str(events)],
        stdin=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        yield process
        process.kill()


def tell(watchdog: subprocess.Popen[str], *lines: str) -> None:
    assert watchdog.stdin is not None
    for line in lines:
        watchdog.stdin.write(f"{line}\n")
    watchdog.stdin.flush()


def hang_up(watchdog: subprocess.Popen[str]) -> int:
    """Close its input as the kernel does when the controller is gone."""
    assert watchdog.stdin is not None
    watchdog.stdin.close()
    return watchdog.wait(60)


def test_the_end_of_the_controller_ends_the_run_and_its_folders(
    watchdog: subprocess.Popen[str], people: Family, scratch: Path, events: Path
) -> None:
    people.start("plain")
    people.start("parent-of-stubborn-stranger", 2)
    people.start("parent-of-nameless", 2)
    tell(watchdog, *(f"session {session.pid} {session.started}" for session in people.sessions))
    assert hang_up(watchdog) == 0
    assert people.living() == []
    assert not scratch.exists()
    assert not events.exists()


def test_a_process_whose_session_it_was_never_told_is_found_by_its_id(
    watchdog: subprocess.Popen[str], people: Family
) -> None:
    # The controller may be killed between starting a process and telling of it.
    people.start("plain")
    assert hang_up(watchdog) == 0
    assert people.living() == []


def test_a_session_whose_number_was_used_again_is_left_alone(
    watchdog: subprocess.Popen[str], people: Family, tmp_path: Path
) -> None:
    with family(tmp_path / "others", "another") as others:
        pids = others.start("plain")
        (session,) = others.sessions
        tell(
            watchdog,
            f"session {session.pid} {session.started - 1}",
            f"collected {session.pid} {session.started}",
        )
        people.start("plain")
        assert hang_up(watchdog) == 0
        assert people.living() == []
        assert others.living() == pids


def test_after_done_it_does_nothing(
    watchdog: subprocess.Popen[str], people: Family, scratch: Path
) -> None:
    pids = people.start("plain")
    (session,) = people.sessions
    tell(watchdog, f"session {session.pid} {session.started}", "done")
    assert hang_up(watchdog) == 0
    assert people.living() == pids
    assert scratch.exists()


def test_signals_for_the_controller_do_not_end_it(
    watchdog: subprocess.Popen[str], people: Family
) -> None:
    people.start("plain")
    tell(watchdog, "session 1234567 1")
    # Its first line can be written before it has set its handlers; a second look is enough.
    wait_for_handlers(watchdog.pid)
    for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(watchdog.pid, each)
    assert alive(watchdog.pid)
    assert hang_up(watchdog) == 0
    assert people.living() == []


def wait_for_handlers(pid: int) -> None:
    def ignores_termination() -> bool:
        status = Path(f"/proc/{pid}/status").read_text()
        mask = next(line for line in status.splitlines() if line.startswith("SigIgn:"))
        return bool(int(mask.split()[1], 16) >> (signal.SIGTERM - 1) & 1)

    wait_for(ignores_termination)
