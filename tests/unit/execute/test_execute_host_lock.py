"""One run at a time on a host, and who is waited for."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from lock_holder import other_holder
from r2bspec.execute.processes.machine import DISABLED_BY, HostBusyError, host_lock, lock_file


@pytest.fixture
def holder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[subprocess.Popen[str]]:
    """A process that has the lock until its standard input is closed, or it is killed."""
    with other_holder(tmp_path, monkeypatch) as process:
        yield process


def test_a_held_lock_is_refused_with_its_holder(holder: subprocess.Popen[str]) -> None:
    with (
        pytest.raises(HostBusyError, match=f"the other one \\(process {holder.pid}\\)") as caught,
        host_lock("mine", wait=False, on_wait=pytest.fail),
    ):
        pytest.fail("the lock is held")
    assert "--no-wait" in caught.value.hint
    assert caught.value.exit_code == 4


def test_the_lock_of_a_killed_run_is_free(holder: subprocess.Popen[str]) -> None:
    holder.kill()
    holder.wait()
    with host_lock("mine", wait=False, on_wait=pytest.fail):
        assert lock_file().read_text() == f"mine (process {os.getpid()})"


def test_the_variable_switches_it_off(
    holder: subprocess.Popen[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(DISABLED_BY, "1")
    with host_lock("mine", on_wait=pytest.fail):
        assert holder.poll() is None


def test_a_link_in_place_of_the_file_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.delenv(DISABLED_BY)
    target = tmp_path / "precious"
    target.write_text("kept")
    lock_file().symlink_to(target)
    with host_lock("mine", on_wait=pytest.fail):
        pass
    assert target.read_text() == "kept"
