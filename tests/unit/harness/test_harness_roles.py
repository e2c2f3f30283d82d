"""Promise: a process of the harness says in its last words what it could not do, with a code."""

from __future__ import annotations

import errno
import os
import socket

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
    assert "--output" in said.hint


@pytest.mark.parametrize("error", [OSError(errno.EPERM, "no"), RuntimeError("no")])
def test_other_errors_keep_their_code(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    assert last_words(monkeypatch, error).code == "R2B630"
