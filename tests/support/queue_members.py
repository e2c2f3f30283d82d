"""Other processes in the queue of this host, which is then of one test alone."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from r2bspec.execute.host_queue import DISABLED_BY

MEMBER = """
import json, sys
from r2bspec.execute.host_queue import host_to_itself
name, seconds = sys.argv[1], json.loads(sys.argv[2])
said = []
def on_wait(place):
    said or print("waits", flush=True)
    said.append(place)
with host_to_itself(name, seconds=seconds, on_wait=on_wait):
    print("runs", flush=True)
    sys.stdin.read()
"""

Member = subprocess.Popen[str]
Join = Callable[..., Member]


def said(member: Member) -> str:
    """Return what a member says next: that it waits, or that it runs."""
    assert member.stdout is not None
    return member.stdout.readline().strip()


def leave(member: Member) -> None:
    """Let a member that runs end."""
    assert member.stdin is not None
    member.stdin.close()
    member.wait()


@contextmanager
def other_members(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Join]:
    """Yield a function that lets one more process join the queue, and returns it when it has.

    Args:
        folder: where the queue is.
        monkeypatch: undoes that at the end of the test.
    """
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.delenv(DISABLED_BY)
    with ExitStack() as stack:

        def join(name: str = "the other one", seconds: str = "null") -> Member:
            member = subprocess.Popen(
                [sys.executable, "-c", MEMBER, name, seconds],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            stack.enter_context(member)
            stack.callback(member.kill)
            assert said(member) in {"runs", "waits"}
            return member

        yield join
