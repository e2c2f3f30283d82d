"""Real processes under the controller's eye: started, listened to, watched, and ended."""

from __future__ import annotations

import gc
import itertools
import os
import secrets
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from r2bspec.execute.bringup.launcher import Launcher
from r2bspec.execute.errors import (
    InterruptedRunError,
    NotInstalledError,
    ProcessDiedError,
    ProcessFailedError,
    RunError,
    StepFailedError,
)
from r2bspec.execute.processes import process, supervisor
from r2bspec.execute.processes.environment import RunEnvironment
from r2bspec.execute.processes.process import ManagedProcess
from r2bspec.execute.processes.supervisor import ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.ipc.process_cleanup import run_processes
from r2bspec.ipc.protocol import RUN_ID_VARIABLE
from r2bspec.ipc.schedule import CyclicSchedule
from r2bspec.middleware.middleware import middleware_of
from r2bspec.plan.plan import SetupPlan
from r2bspec.record.run_folder import RunFolder
from run_simulation import Simulation

HANG_S = 60.0
"""Guards against hanging only; nothing that passes takes so long."""

PRELUDE = """
import os, signal, subprocess, sys, time
def channel():
    global protocol
    from r2bspec.ipc import protocol
    from r2bspec.harness.control_channel import Channel
    return Channel.from_environment()
def ignore(*numbers):
    for number in numbers:
        signal.signal(number, signal.SIG_IGN)
def shout(number, frame):
    print("got", signal.Signals(number).name, flush=True)
"""

ANSWERS = """
ends = channel()
while True:
    command = ends.receive()
    if isinstance(command, protocol.Shutdown):
        sys.exit(0)
    if isinstance(command, protocol.Play):
        ends.send(protocol.Played(steps=command.steps))
"""

SLEEPS = "print('here', flush=True)\nwhile True: time.sleep(60)\n"


class Stage:
    """ProcessSupervisor, and short ways to start some."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.run_id = secrets.token_hex(8)
        self.interrupt: Callable[[], None] = lambda: None
        self.children = ProcessSupervisor(self.run_id, folder / "scratch", lambda: self.interrupt())

    def start(
        self, program: str, name: str = "node", role: str = "host", **more: Any
    ) -> ManagedProcess:
        return self.run([sys.executable, "-c", PRELUDE + program], name, role, **more)

    def run(
        self, argv: list[str], name: str = "node", role: str = "host", **more: Any
    ) -> ManagedProcess:
        environment = os.environ | {RUN_ID_VARIABLE: self.run_id, "PYTHONUNBUFFERED": "1"}
        log = self.folder / f"{name}.log"
        return self.children.start(name, role, argv, environment, cwd=self.folder, log=log, **more)

    def pump_until(self, condition: Callable[[], object]) -> None:
        assert self.children.pump_until(condition, HANG_S), "what is waited for did not happen"

    def pump_for_ever(self) -> None:
        self.pump_until(lambda: False)

    def said(self, name: str = "node") -> str:
        return (self.folder / f"{name}.log").read_text()


def open_files() -> int:
    gc.collect()  # what an earlier test has left is not closed in between
    return len(list(Path("/proc/self/fd").iterdir()))


def make_impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the waits short that politeness costs."""
    for constant, seconds in (("MAX_EXIT_S", 0.4), ("MAX_SIGTERM_S", 0.3)):
        monkeypatch.setattr(process, constant, seconds)
    monkeypatch.setattr(middleware_of({}), "exit_in_turn_s", 0.1)
    monkeypatch.setattr(supervisor, "MAX_SIGTERM_S", 0.3)
    monkeypatch.setattr(supervisor, "_WATCHDOG_EXIT_S", 2.0)


@pytest.fixture
def stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Stage]:
    before = open_files()
    found = Stage(tmp_path)
    yield found
    make_impatient(monkeypatch)
    if found.children._watchdog.poll() is None:
        found.children.close()
    assert run_processes(found.run_id, [each.session for each in found.children._all]) == []
    assert found.children._watchdog.poll() is not None
    assert open_files() == before


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A controller that does not wait long for processes to end by themselves."""
    make_impatient(monkeypatch)


# Listening


def test_an_answer_that_does_not_come_is_not_waited_for_for_ever(stage: Stage) -> None:
    child = stage.start("ends = channel()\n" + SLEEPS)
    with pytest.raises(RunError, match=r"process node did not respond within 0\.2 s") as raised:
        stage.children.request(child, protocol.CountMatches(), protocol.Matched, 0.2)
    assert raised.value.code == "R2B632"
    assert str(child.log) in raised.value.hint


@pytest.mark.timeout(120)
def test_a_command_that_a_stopped_child_does_not_take_blocks_nobody(
    stage: Stage, monkeypatch: pytest.MonkeyPatch, impatient: None
) -> None:
    monkeypatch.setattr(process, "_SEND_TIMEOUT_S", 0.3)
    child = stage.start(ANSWERS)
    os.kill(child.pid, signal.SIGSTOP)
    steps = tuple((number,) for number in range(300_000))
    large = protocol.LoadSchedule(schedule=CyclicSchedule(steps=steps))
    with pytest.raises(RunError, match="did not respond"):
        stage.children.request(child, large, protocol.Ready, 0.2)


# Several parts in one process


PARTS = """
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


def play(steps: int) -> protocol.Play:
    return protocol.Play(rate_hz=1.0, steps=steps)


@pytest.fixture
def whole(stage: Stage) -> ManagedProcess:
    """Several parts of the harness in one process: each speaks and listens for itself."""
    return stage.start(PARTS, "harness", "harness", parts=("player", "monitor"))


def test_each_part_answers_for_itself_and_ends_before_its_process(
    stage: Stage, whole: ManagedProcess
) -> None:
    children = stage.children
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


# Dying


def test_a_death_is_reported_with_the_last_lines_of_the_log(stage: Stage) -> None:
    stage.start(
        "for n in range(99): print('line', n)\nprint('no GPU', file=sys.stderr); sys.exit(3)"
    )
    with pytest.raises(ProcessDiedError) as raised:
        stage.pump_for_ever()
    message = str(raised.value)
    assert message.startswith("process node exited with status 3; its last output:\n")
    assert message.endswith("line 98\nno GPU")
    assert "line 80" not in message
    assert str(stage.folder / "node.log") in raised.value.hint
    assert raised.value.exit_code == 4
    assert stage.said().count("line") == 99


FAILS = "channel().send(protocol.Failed(code={!r}, message='m', hint={!r}))\n"
# A fork without exec, as multiprocessing does it, keeps the socket open.
FORKS = "ends = channel()\nif os.fork() == 0:\n    time.sleep(600)\nsys.exit(5)"
NO_TEXT = "os.write(1, b'\\xff\\xfe caf\\xc3\\xa9\\n'); sys.exit(1)"
DIED, FAILED, MISSING = ProcessDiedError, ProcessFailedError, NotInstalledError


@pytest.mark.parametrize(
    ("program", "kind", "message"),
    [
        ("sys.exit(0)", DIED, "process node exited with status 0; it printed nothing"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", DIED, "process node was killed by SIGSEGV"),
        ("sys.exit(102)", DIED, "exited with status 102"),
        (NO_TEXT, DIED, "caf\u00e9"),
        (FORKS, DIED, "exited with status 5"),
        (FAILS.format("R2B624", "") + SLEEPS, MISSING, "^node: m$"),
        # What it says before it dies is the reason.
        (FAILS.format("R2B633", "fix it") + "sys.exit(1)", FAILED, "^node: m$"),
        (FAILS.format("R2B630", "") + SLEEPS, FAILED, "^node: m$"),
    ],
)
def test_an_end_that_nobody_expects_is_an_error_that_says_why(
    stage: Stage, program: str, kind: type[RunError], message: str
) -> None:
    stage.start(program)
    with pytest.raises(kind, match=message) as raised:
        stage.pump_for_ever()
    assert raised.value.exit_code == (4 if kind is DIED or raised.value.code == "R2B630" else 2)
    if kind is FAILED:
        log = f"Its output is in {stage.folder / 'node.log'}."
        assert raised.value.hint == ("fix it" if raised.value.code == "R2B633" else log)


def test_a_signal_that_the_run_has_sent_is_recorded(stage: Stage) -> None:
    child = stage.start(SLEEPS)
    child.exit_expected = True
    child.signal(signal.SIGINT)
    stage.children.end([child])
    [record] = stage.children.records()
    assert signal.SIGINT in record.signals
    assert record.ended_as_told


# Starting


@pytest.mark.parametrize(
    ("program", "reason"), [("nothing", "No such file"), ("text", "Permission denied")]
)
def test_what_cannot_be_started_is_named(stage: Stage, program: str, reason: str) -> None:
    (stage.folder / "text").write_text("text")
    with pytest.raises(NotInstalledError, match=rf"\./{program}: {reason}") as raised:
        stage.run([f"./{program}"])
    assert raised.value.code == "R2B621"
    assert stage.children.records() == ()


def test_a_process_runs_in_a_session_of_its_own_without_a_terminal(stage: Stage) -> None:
    child = stage.start("print(repr(sys.stdin.read()))\n" + SLEEPS, role="command")
    stage.pump_until(lambda: "here" in stage.said())
    assert os.getsid(child.pid) == child.pid
    assert os.getpgid(child.pid) == child.pid
    assert "''" in stage.said()


def test_a_process_inherits_nothing_but_its_channel(stage: Stage) -> None:
    first = stage.start(ANSWERS, "first")
    second = stage.start("ends = channel()\n" + SLEEPS, "second")
    stage.pump_until(lambda: "here" in stage.said("second"))
    kinds = [
        str(each.readlink())
        for each in Path(f"/proc/{second.pid}/fd").iterdir()
        if each.name not in {"0", "1", "2"}
    ]
    assert len([kind for kind in kinds if kind.startswith("socket:")]) == 1
    assert first.connection is not None
    ours = str(Path(f"/proc/self/fd/{first.connection.fileno()}").readlink())
    assert ours not in kinds


def test_a_setup_step_has_to_create_its_file_and_does_so_once(stage: Stage) -> None:
    environment = RunEnvironment(
        Simulation().plan(),
        run_id=stage.run_id,
        domain=1,
        scratch=stage.folder,
        largest_message_bytes=1,
    )
    folder = RunFolder.create(stage.folder / "run")
    launcher = Launcher(stage.children, environment, folder, stage.folder)
    notes: list[str] = []

    def run(*argv: str) -> None:
        plan = SetupPlan(
            name="get", argv=argv, creates="made", directory=".", env={}, timeout_ns=10**11
        )
        launcher.run_setup_step(plan, notes.append)

    with pytest.raises(StepFailedError, match=r"setup\.get exited with status 1; it printed"):
        run("false")
    with pytest.raises(StepFailedError, match="get succeeded, but made does not exist"):
        run("true")
    run("touch", "made")
    run("false")
    assert notes[-2:] == ["get: touch made", "get: made already exists"]


# Ending


def test_processes_end_one_after_another(stage: Stage) -> None:
    leaves = "ends = channel()\nends.send(protocol.Ready())\nends.receive()\ntime.sleep(0.05)\n"
    leaves += "print(time.monotonic(), flush=True)\nsys.exit(0)"
    started = [stage.start(leaves, f"node{number}") for number in range(3)]
    for child in started:
        stage.children.answer(child, protocol.Ready, HANG_S)
    asked: dict[str, float] = {}
    ask = ManagedProcess.request_shutdown

    def noted(child: ManagedProcess) -> None:
        asked[child.name] = time.monotonic()
        ask(child)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ManagedProcess, "request_shutdown", noted)
        stage.children.end(started)
    # Nobody is asked before the one before has left, so that no two leave ROS at the same time.
    for before, after in itertools.pairwise(asked):
        assert float(stage.said(before)) < asked[after]


def test_a_process_that_hangs_takes_no_time_from_those_that_are_asked_after_it(
    stage: Stage, impatient: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    hangs = [stage.start("channel().send(protocol.Ready())\n" + SLEEPS, f"n{n}") for n in range(2)]
    polite = stage.start(ANSWERS, "polite")
    for child in hangs:
        stage.children.answer(child, protocol.Ready, HANG_S)
    stage.children.request(polite, play(1), protocol.Played, HANG_S)
    # All turns together take as long as a process may take after its request.
    for owner, constant in ((middleware_of({}), "exit_in_turn_s"), (process, "MAX_EXIT_S")):
        monkeypatch.setattr(owner, constant, 2.0)
    stage.children.end([*hangs, polite])
    assert polite.process.returncode == 0
    assert {child.process.returncode for child in hangs} == {-signal.SIGTERM}


LEAVES = "def leave(number, frame): shout(number, frame); sys.exit(0)\n"
STUBBORN = "signal.signal(signal.SIGINT, shout); signal.signal(signal.SIGTERM, shout)\n"
READY = "ends = channel()\nends.send(protocol.Ready())\n"


@pytest.mark.parametrize(
    ("program", "role", "status", "said"),
    [
        (LEAVES + "signal.signal(signal.SIGINT, leave)\n", "command", 0, ["SIGINT"]),
        (STUBBORN, "command", -signal.SIGKILL, ["SIGINT", "SIGTERM"]),
        (READY, "host", -signal.SIGTERM, []),
    ],
)
def test_politeness_is_given_up_step_by_step(
    stage: Stage, impatient: None, program: str, role: str, status: int, said: list[str]
) -> None:
    child = stage.start(program + SLEEPS, role=role)
    stage.pump_until(lambda: "here" in stage.said())
    if role == "host":
        stage.children.answer(child, protocol.Ready, HANG_S)
    stage.children.end([child])
    assert child.process.returncode == status
    assert stage.said() == "here\n" + "".join(f"got {name}\n" for name in said)


# Being interrupted


def test_an_interrupt_is_seen_while_an_answer_is_awaited(stage: Stage) -> None:
    child = stage.start("ends = channel()\n" + SLEEPS)

    def interrupt() -> None:
        raise InterruptedRunError("interrupted by SIGINT")

    stage.pump_until(lambda: "here" in stage.said())
    stage.interrupt = interrupt
    with pytest.raises(InterruptedRunError):
        stage.children.request(child, protocol.CountMatches(), protocol.Matched, HANG_S)


def test_a_watchdog_that_was_stopped_does_not_outlive_the_run(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_impatient(monkeypatch)
    stage.children._watchdog.send_signal(signal.SIGSTOP)
    stage.children.close()
    assert stage.children._watchdog.poll() == -signal.SIGKILL
    assert not stage.children.lost_watchdog


def test_a_watchdog_that_was_killed_is_known(stage: Stage) -> None:
    stage.children._watchdog.kill()
    stage.children._watchdog.wait()
    stage.children.close()
    assert stage.children.lost_watchdog
