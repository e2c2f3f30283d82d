"""A command of a build or a setup ends, with all that it has started."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from r2bspec.execute.errors import WorkspaceError
from r2bspec.execute.processes import bounded_command
from r2bspec.execute.processes.bounded_command import run_bounded
from r2bspec.execute.processes.environment import workspace_environment


def test_what_it_prints_is_kept_and_its_failure_told() -> None:
    assert run_bounded(["sh", "-c", "echo a; echo b >&2"], timeout_s=60).printed == b"a\n"
    ended = run_bounded(["sh", "-c", "echo a; echo b >&2; exit 3"], timeout_s=60)
    assert ended == ("ended with 3", b"", "b")
    assert run_bounded(["/nowhere"], timeout_s=60).problem.startswith("cannot be started")


def test_a_command_that_prints_without_end_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounded_command, "MAX_COMMAND_OUTPUT_BYTES", 1 << 20)
    for stream in ("1", "2"):
        ended = run_bounded(["sh", "-c", f"yes >&{stream}"], timeout_s=60)
        assert ended.problem == "printed more than 1 MiB"


def test_what_a_setup_file_has_started_ends_with_it(tmp_path: Path) -> None:
    setup = tmp_path / "setup.sh"
    setup.write_text(f"sleep 600 & echo $! > '{tmp_path}/child'; export MADE=1\n")
    assert workspace_environment(str(setup)) == {"MADE": "1"}
    child = int((tmp_path / "child").read_text())
    while (stat := Path(f"/proc/{child}/stat")).exists() and stat.read_text().split()[2] != "Z":
        time.sleep(0.01)


def test_a_setup_file_that_takes_too_long_is_ended_with_its_children(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("r2bspec.execute.processes.environment._SOURCE_TIMEOUT_S", 0.3)
    setup = tmp_path / "setup.sh"
    setup.write_text(f"sleep 600 & echo $! > '{tmp_path}/child'; wait\n")
    with pytest.raises(WorkspaceError, match="did not end within 0.3 s"):
        workspace_environment(str(setup))
    child = int((tmp_path / "child").read_text())
    while (stat := Path(f"/proc/{child}/stat")).exists() and stat.read_text().split()[2] != "Z":
        time.sleep(0.01)
    assert not os.path.exists(f"/proc/{child}") or stat.read_text().split()[2] == "Z"  # noqa: PTH110
