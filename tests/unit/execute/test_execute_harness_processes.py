"""Several parts of the harness in one process: each speaks and listens for itself."""

from __future__ import annotations

import os
import secrets
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from r2bspec.execute.errors import ProcessDiedError, ProcessFailedError
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.ipc.protocol import RUN_ID_VARIABLE

HANG_S = 60.0
"""Guards against hanging only; nothing that passes takes so long."""

PROGRAM = """
import os, select, sys
from r2bspec.ipc import protocol
from r2bspec.harness.control_channel import Channel
ends = {part: Channel.from_environment(part) for part in ("", "player", "monitor")}
assert not [name for name in os.environ if name.startswith(protocol.CONTROL_FD_VARIABLE)]
while True:
    for part, own in list(ends.items()):
        if not own.wait(0.01):
            continue
        match own.receive():
            case protocol.Play(steps=0):
                own.send(protocol.Failed(code="R2B630", message="cannot play nothing"))
            case protocol.Play(steps=steps):
                own.send(protocol.Played(steps=steps + len(part)))
            case protocol.Stop():
                sys.exit(3)
            case protocol.Shutdown() if part:
                ends.pop(part).close()
            case protocol.Shutdown():
                sys.exit(4 if len(ends) > 1 else 0)
"""


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.fixture
def children(tmp_path: Path) -> Iterator[ProcessSupervisor]:
    before = open_files()
    made = ProcessSupervisor(secrets.token_hex(8), tmp_path, lambda: None)
    yield made
    assert made.close() == []
    assert open_files() == before


@pytest.fixture
def whole(children: ProcessSupervisor, tmp_path: Path) -> ManagedProcess:
    return children.start(
        "harness",
        "harness",
        [sys.executable, "-c", PROGRAM],
        os.environ | {RUN_ID_VARIABLE: "parts"},
        cwd=Path.cwd(),
        log=tmp_path / "harness.log",
        parts=("player", "monitor"),
    )


def play(steps: int) -> protocol.Play:
    return protocol.Play(rate_hz=1.0, steps=steps)


def test_each_part_answers_what_it_was_asked(
    children: ProcessSupervisor, whole: ManagedProcess
) -> None:
    player, monitor = whole.parts["player"], whole.parts["monitor"]
    for each in (monitor, whole, player):
        each.send(play(10))
    # In another order than they were asked.
    assert children.answer(player, protocol.Played, HANG_S).steps == 10 + len("player")
    assert children.answer(whole, protocol.Played, HANG_S).steps == 10
    assert children.answer(monitor, protocol.Played, HANG_S).steps == 10 + len("monitor")


def test_there_is_one_process_in_the_record(
    children: ProcessSupervisor, whole: ManagedProcess
) -> None:
    assert [each.name for each in children.records()] == ["harness"]
    assert [each.name for each in children] == ["harness"]
    assert {each.pid for each in whole.parts.values()} == {whole.pid}


def test_a_part_that_fails_is_named(children: ProcessSupervisor, whole: ManagedProcess) -> None:
    whole.parts["player"].send(play(0))
    with pytest.raises(ProcessFailedError, match="^player: cannot play nothing"):
        pump(children)


def test_a_process_that_dies_takes_its_parts_along(
    children: ProcessSupervisor, whole: ManagedProcess
) -> None:
    whole.parts["monitor"].send(protocol.Stop())
    with pytest.raises(ProcessDiedError, match="process harness exited with status 3"):
        pump(children)


def test_the_parts_end_before_their_process(
    children: ProcessSupervisor, whole: ManagedProcess
) -> None:
    children.request(whole, play(1), protocol.Played, HANG_S)
    children.end([whole])
    assert whole.process.returncode == 0
    assert list(children) == []


def pump(children: ProcessSupervisor) -> None:
    deadline = time.monotonic() + HANG_S
    while time.monotonic() < deadline:
        children.pump()
