"""Several parts of the harness in one process: each speaks and listens for itself."""

from __future__ import annotations

import os
import secrets
import sys
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


def test_each_part_answers_for_itself_and_ends_before_its_process(
    children: ProcessSupervisor, whole: ManagedProcess
) -> None:
    player, monitor = whole.parts["player"], whole.parts["monitor"]
    for child in (whole, player, monitor):
        child.send(play(10))
    # In another order than they were asked.
    for child, name in ((player, "player"), (whole, ""), (monitor, "monitor")):
        assert children.answer(child, protocol.Played, HANG_S).steps == 10 + len(name)
    assert [record.name for record in children.records()] == ["harness"]
    assert {player.pid, monitor.pid} == {whole.pid}
    children.end([whole])
    assert whole.process.returncode == 0
    assert list(children) == []


def test_a_part_that_fails_is_named(children: ProcessSupervisor, whole: ManagedProcess) -> None:
    whole.parts["player"].send(play(0))
    with pytest.raises(ProcessFailedError, match="^player: cannot play nothing"):
        children.pump_for(HANG_S)


def test_a_process_that_dies_takes_its_parts_along(
    children: ProcessSupervisor, whole: ManagedProcess
) -> None:
    whole.parts["monitor"].send(protocol.Stop())
    with pytest.raises(ProcessDiedError, match="process harness exited with status 3"):
        children.pump_for(HANG_S)
