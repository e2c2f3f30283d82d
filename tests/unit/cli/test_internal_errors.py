"""What no code foresaw ends as one line with a code and exit status 70, in workers, too."""

from __future__ import annotations

import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import r2bspec.cli.check_files as check_files_module
from command_line import Call
from example_spec import example
from r2bspec.cli import main as cli
from r2bspec.errors import ExitStatus

LONGEST_S = 60
"""Ends only what would not end."""


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of temporary files of the test's own."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


def _nested(depth: int = 0) -> int:
    return _nested(depth + 1) + 1


def _raise(error: Exception) -> None:
    raise error


CRASHES: dict[str, Callable[[], object]] = {
    "RecursionError": _nested,
    "MemoryError": lambda: _raise(MemoryError()),
    "TypeError": lambda: len(5),  # type: ignore[arg-type]
    "UnicodeEncodeError": lambda: "\ud800".encode(),
}


@pytest.mark.parametrize("kind", CRASHES)
def test_a_crash_is_a_line_a_file_and_status_70(
    kind: str, temporary: Path, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    monkeypatch.setattr(cli.command, "invoke", lambda _: CRASHES[kind]())
    shown = call("validate", status=ExitStatus.INTERNAL_ERROR)
    assert shown.out == ""
    (line,) = shown.err.splitlines()
    assert line.startswith(f"error[R2B690 internal-error]: {kind} in r2bspec (")
    assert "report it to the issue tracker of r2bspec" in line
    (file,) = temporary.iterdir()
    assert line.endswith(f"with the traceback in {file}")
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert "Traceback (most recent call last):" in file.read_text()
    assert kind in file.read_text()


def test_the_line_has_nothing_of_the_input(
    temporary: Path, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    crash = ValueError("\x1b[2J\n::error::hunter2")
    monkeypatch.setattr(cli.command, "invoke", lambda _: _raise(crash))
    shown = call("validate", status=ExitStatus.INTERNAL_ERROR).err
    assert "hunter2" not in shown
    assert "\x1b" not in shown
    (file,) = temporary.iterdir()
    assert "hunter2" in file.read_text()


def test_a_crash_names_the_file_that_led_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    (tmp_path / "a.r2b.yaml").write_text(example())
    monkeypatch.setattr(check_files_module, "_load", lambda *_: _nested())
    shown = call("validate", tmp_path, status=ExitStatus.INTERNAL_ERROR)
    assert shown.err.endswith(f"while checking '{tmp_path}/a.r2b.yaml'\n")


def test_an_output_without_room_is_no_internal_error() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "r2bspec", "docs", "R2B690"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    line, way_out = done.stderr.splitlines()
    assert line.startswith("error[R2B651 ")
    assert line.endswith("the output cannot be written: No space left on device")
    assert way_out.startswith("  help: ")
    assert done.returncode == ExitStatus.USAGE
