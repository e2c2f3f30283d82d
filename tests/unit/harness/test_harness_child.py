"""A process of the harness: how it starts, what it says last, and that it ends."""

from __future__ import annotations

import errno
import os
import socket
import subprocess
import sys

import pytest

from r2bspec.harness import child
from r2bspec.harness.control_channel import Channel
from r2bspec.ipc import protocol


def last_words(monkeypatch: pytest.MonkeyPatch, error: Exception) -> protocol.Failed:
    """What a process tells the controller when its role ends with an error."""
    ours, theirs = socket.socketpair()

    def fail(*_: object) -> child.Role:
        raise error

    monkeypatch.setattr(child, "_make_role", fail)
    with ours, theirs:
        ours.sendall(protocol.encode(protocol.ListGraph()))
        assert child.play_role(Channel(theirs)) == 1
        said = protocol.decode_reply(ours.recv(1 << 16))
    assert isinstance(said, protocol.Failed)
    return said


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS])
def test_a_disk_that_takes_no_more_is_named_with_the_file(
    monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    said = last_words(monkeypatch, OSError(number, os.strerror(number), "/there/monitor.rows"))
    assert said.code == "R2B651"
    assert said.message == f"/there/monitor.rows cannot be written: {os.strerror(number)}"
    assert ("ulimit -f" if number == errno.EFBIG else "--output") in said.hint


def test_a_library_that_cannot_be_loaded_is_named_behind_the_error_that_hides_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hides = RuntimeError("no type support")
    hides.__context__ = ImportError("libx.so: failed to map segment")
    assert last_words(monkeypatch, hides).message == f"no type support: {hides.__context__}"


SHARED = (
    *("harness.control_channel", "harness.watchdog", "ipc.buffers", "ipc.process_cleanup"),
    *("ipc.protocol", "ipc.sample_files", "record.files"),
)


def test_shared_modules_import_neither_ros_nor_numpy() -> None:
    program = (
        f"import sys; import {', '.join(f'r2bspec.{module}' for module in SHARED)}; "
        "print([name for name in ('rclpy', 'numpy', 'scipy') if name in sys.modules])"
    )
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    assert said.stdout.strip() == b"[]"


def test_a_harness_program_that_is_started_by_hand_says_so() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "r2bspec.harness.child"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr == "this program is started by 'r2bspec run' and cannot be run alone\n"
