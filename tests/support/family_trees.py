"""Small real programs that behave as badly as nodes do, and ways to watch them."""

from __future__ import annotations

import os
import secrets
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from r2bspec.ipc.process_cleanup import ProcessSession, SessionLeader
from r2bspec.ipc.protocol import RUN_ID_VARIABLE

_DEADLINE_S = 30.0

_PROGRAM = """
import os, signal, subprocess, sys, time
kind, said = sys.argv[1:]
me, _, child = kind.partition("-of-")
if "stubborn" in me:
    for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(each, signal.SIG_IGN)
if child:
    next_one = child.partition("-of-")[0]
    subprocess.Popen(
        [sys.executable, __file__, child, said],
        start_new_session="stranger" in next_one,
        env={} if "nameless" in next_one else None,
    )
if "gone" in me:
    sys.exit(0)
with open(said, "a") as file:
    file.write(f"{os.getpid()}\\n")
while True:
    time.sleep(60)
"""


def wait_for(condition: Callable[[], object]) -> None:
    """Wait until something is true.

    Raises:
        AssertionError: it did not become so within a deadline that only guards against hanging.
    """
    deadline = time.monotonic() + _DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline, "what the test waits for did not happen"
        time.sleep(0.01)


def alive(pid: int) -> bool:
    """Whether a process still runs; a zombie does not."""
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


class Family:
    """Processes that carry a run id; whatever is left of them ends with the test."""

    def __init__(self, folder: Path, run_id: str) -> None:
        self._folder = folder
        self.run_id = run_id
        self._program = folder / "program.py"
        folder.mkdir(exist_ok=True)
        self._program.write_text(_PROGRAM)
        self._started: list[SessionLeader] = []
        self._seen: set[int] = set()

    def start(self, kind: str, members: int = 1) -> list[int]:
        """Start a program in a session of its own; returns the ids once `members` are running.

        A kind is a person, or a parent of one: ``parent-of-stubborn-stranger`` starts a child
        and lives on. The ``stubborn`` ignore polite signals, the ``gone`` end as soon as they
        have started their child, a ``stranger`` opens a session of its own, and the
        ``nameless`` have an empty environment.
        """
        said = self._folder / f"said-{len(self._started)}"
        said.touch()
        process = SessionLeader(
            [sys.executable, str(self._program), kind, str(said)],
            env=os.environ | {RUN_ID_VARIABLE: self.run_id},
        )
        self._started.append(process)
        wait_for(lambda: len(said.read_text().split()) >= members)
        pids = [int(each) for each in said.read_text().split()]
        self._seen.update(pids)
        return pids

    @property
    def sessions(self) -> list[ProcessSession]:
        """The sessions that were opened."""
        return [process.session for process in self._started]

    def collect(self) -> None:
        """Collect what has ended, as a controller does."""
        for process in self._started:
            process.poll()

    def living(self) -> list[int]:
        """Those that still run."""
        return sorted(pid for pid in self._seen if alive(pid))

    def end(self) -> None:
        """Kill what is left."""
        for pid in self.living():
            psutil.Process(pid).kill()
        for process in self._started:
            process.kill()
            process.wait()


@pytest.fixture
def run_id() -> str:
    """That of a run of the test's own."""
    return secrets.token_hex(8)


@pytest.fixture
def people(tmp_path: Path, run_id: str) -> Iterator[Family]:
    """Processes of that run."""
    with family(tmp_path, run_id) as found:
        yield found


@contextmanager
def family(folder: Path, run_id: str) -> Iterator[Family]:
    """A family that ends with the context."""
    found = Family(folder, run_id)
    try:
        yield found
    finally:
        found.end()
