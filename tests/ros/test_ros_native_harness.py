"""Native players and monitors, commanded without a run: what is published is what arrives."""

from __future__ import annotations

import contextlib
import functools
import os
import secrets
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from c_nodes import c_node
from native_playlists import SANITIZERS
from r2bspec.bags.message_types import read_stamp
from r2bspec.execute.bringup.harness_processes import GraphJoins
from r2bspec.execute.errors import ProcessFailedError, RunError
from r2bspec.execute.processes.prerequisites import reserved_domain
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.ipc.buffers import BufferWriter
from r2bspec.ipc.playback_file import PlaybackReader
from r2bspec.ipc.protocol import RUN_ID_VARIABLE
from r2bspec.ipc.sample_files import ArrivalReader, StallLogReader
from r2bspec.ipc.schedule import CyclicSchedule
from r2bspec.language.spec import QoS
from r2bspec.native.build import (
    BuildError,
    find_compiler,
    harness_library,
    harness_program,
    join_environment,
    join_object,
)
from r2bspec.plan.plan import InputPlan, JoinPlan, MonitorPlan, ProcessPlan
from r2bspec.record.sample_arrays import MONITOR_FIELDS, PLAYBACK_FIELDS
from ros_runs import Bench, relay_spec

IMAGE = "sensor_msgs/msg/Image"
TOPIC = "/r2b/image"
HANG_S = 60.0
SIZES = (0, 1_000_000, 8, 300_000, 4)
"""In multiples of four bytes, to which messages between processes are filled up."""
OUT = MonitorPlan(name="out", topic=TOPIC, type=IMAGE, match="stamp", qos=QoS(depth=100))


@functools.cache
def messages() -> list[bytes]:
    """The same ones each time: what is between their fields is by chance."""
    from rclpy.serialization import serialize_message
    from sensor_msgs.msg import Image

    return [bytes(serialize_message(Image(data=bytes([n]) * size))) for n, size in enumerate(SIZES)]


@contextlib.contextmanager
def raw_messages(domain: int) -> Iterator[tuple[list[bytes], Callable[[], None]]]:
    """The serialised messages of the topic, and what takes those that have arrived."""
    import rclpy
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor
    from sensor_msgs.msg import Image

    context = Context()
    rclpy.init(context=context, domain_id=domain)
    content: list[bytes] = []
    node = rclpy.create_node("reader", context=context)
    node.create_subscription(Image, TOPIC, content.append, 100, raw=True)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        yield content, lambda: executor.spin_once(timeout_sec=0.1)
    finally:
        executor.shutdown()
        rclpy.shutdown(context=context)


class Harness:
    """A player and a monitor with a supervisor of their own."""

    def __init__(self, folder: Path, domain: int) -> None:
        self.folder = folder
        self.run_id = secrets.token_hex(8)
        self.children = ProcessSupervisor(self.run_id, folder, lambda: None)
        self.domain = domain
        self.buffers = folder / "buffers"
        self.rows = folder / "rows"
        for each in (self.buffers, self.rows):
            each.mkdir()
        writer = BufferWriter(self.buffers, TOPIC, IMAGE, has_header=True)
        for number, data in enumerate(messages()):
            writer.append(number, data)
        writer.close()

    def environment(self) -> dict[str, str]:
        return os.environ | {
            RUN_ID_VARIABLE: self.run_id,
            "ROS_DOMAIN_ID": str(self.domain),
            # What middleware and interpreter keep until the end of their process is not ours.
            "ASAN_OPTIONS": "detect_leaks=0",
        }

    def start(
        self, name: str, parts: tuple[str, ...] = (), flags: tuple[str, ...] = ()
    ) -> ManagedProcess:
        environment = self.environment()
        log = self.folder / f"{name}.log"
        program = [str(harness_program(flags=flags))]
        return self.children.start(
            name,
            name,
            program,
            environment,
            cwd=self.folder,
            log=log,
            parts=parts,
            native=("", *parts),
        )

    def ask(self, child: ManagedProcess, command: Any, kind: Any = protocol.Matched) -> Any:
        return self.children.request(child, command, kind, HANG_S)

    def configure_player(self, player: ManagedProcess) -> None:
        inputs = (
            InputPlan(topic=TOPIC, type=IMAGE, source=TOPIC, bag_topic="", qos=QoS(depth=100)),
        )
        ready = self.ask(
            player,
            protocol.ConfigurePlayer(
                inputs=inputs, buffer_dir=str(self.buffers), rows=str(self.rows / "played")
            ),
            protocol.Ready,
        )
        assert ready.headers == {TOPIC: True}
        schedule = CyclicSchedule(steps=tuple((n,) for n in range(len(SIZES))))
        self.ask(player, protocol.LoadSchedule(schedule=schedule), protocol.Ready)

    def configure(self, player: ManagedProcess, monitor: ManagedProcess) -> None:
        self.configure_player(player)
        watched = protocol.ConfigureMonitor(monitors=(OUT,), rows_dir=str(self.rows))
        assert self.ask(monitor, watched, protocol.Ready).rmw
        self.ask(monitor, protocol.Subscribe(monitors=(OUT,)))

    def match(self, *ends: ManagedProcess, count: int = 1) -> None:
        def matches(end: ManagedProcess) -> int:
            counted: protocol.Matched = self.ask(end, protocol.CountMatches())
            return counted.counts[TOPIC]

        assert self.children.pump_until(lambda: min(map(matches, ends)) >= count, HANG_S)

    def played(self) -> Any:
        return PlaybackReader(self.rows / "played", PLAYBACK_FIELDS).read()

    def received(self, name: str, count: int) -> Any:
        rows = ArrivalReader(self.rows / f"{name}.rows", MONITOR_FIELDS)
        assert self.children.pump_until(lambda: rows.count() >= count, HANG_S), rows.count()
        return rows.read()


@pytest.fixture
def harness(tmp_path: Path) -> Iterator[Harness]:
    with reserved_domain() as domain:
        made = Harness(tmp_path, domain)
        yield made
        assert made.children.close() == []


@pytest.fixture(params=["two processes", pytest.param("one process", marks=only_nightly())])
def ends(harness: Harness, request: pytest.FixtureRequest) -> tuple[ManagedProcess, ManagedProcess]:
    if request.param == "two processes":
        player, monitor = harness.start("player"), harness.start("monitor")
    else:
        parts = ("player", "monitor")
        whole = harness.start("harness", parts)
        harness.ask(whole, protocol.ConfigureHarness(parts=parts), protocol.Ready)
        player, monitor = whole.parts["player"], whole.parts["monitor"]
    harness.configure(player, monitor)
    harness.match(player, monitor)
    return player, monitor


def test_messages_arrive_as_they_were_with_the_stamp_of_their_step(
    harness: Harness, ends: tuple[ManagedProcess, ManagedProcess]
) -> None:
    player, _ = ends
    steps = 3 * len(SIZES)
    with raw_messages(harness.domain) as (content, spin):
        harness.match(player, count=2)
        done = harness.ask(player, protocol.Play(rate_hz=200.0, steps=steps), protocol.Played)
        assert done.steps == steps
        played = harness.played()
        rows = harness.received("out", steps)
        deadline = time.monotonic() + HANG_S
        while len(content) < steps and time.monotonic() < deadline:
            spin()
    assert rows["stamp_ns"].tolist() == played["stamp_ns"].tolist()
    assert (rows["received_ns"] <= rows["taken_ns"]).all()
    assert (rows["received_ns"] > played["published_ns"]).all()
    assert len(content) == steps
    for data, stamp_ns, original in zip(content, played["stamp_ns"], 3 * messages(), strict=True):
        expected = bytearray(original)
        struct.pack_into("<iI", expected, 4, *divmod(int(stamp_ns), 10**9))
        assert data == bytes(expected)
        assert read_stamp(data) == stamp_ns
    # The buffers on the disk are as they were: what is stamped is a copy.
    assert (harness.buffers / "r2b%image.cdr").read_bytes() == b"".join(messages())


def test_a_command_stops_it_between_two_steps(
    harness: Harness, ends: tuple[ManagedProcess, ManagedProcess]
) -> None:
    player, _ = ends
    player.send(protocol.Play(rate_hz=50.0, steps=100_000))
    harness.received("out", 5)
    player.send(protocol.Stop())
    done = harness.children.answer(player, protocol.Played, HANG_S)
    assert 5 <= done.steps < 100_000
    assert harness.played().size == done.steps
    harness.received("out", done.steps)
    # The next playback goes on with the next message of the round.
    harness.ask(player, protocol.Play(rate_hz=50.0, steps=1), protocol.Played)
    rows = harness.received("out", done.steps + 1)
    sizes = [len(message) for message in messages()]
    assert rows["bytes"].tolist() == [sizes[n % len(sizes)] for n in range(done.steps + 1)]


def test_sanitizers_find_nothing(harness: Harness) -> None:
    try:
        player, monitor = (harness.start(name, flags=SANITIZERS) for name in ("player", "monitor"))
    except BuildError as error:
        if "san" in str(error):
            pytest.skip(f"the compiler has no sanitizers here: {error}")
        raise
    harness.configure(player, monitor)
    harness.match(player, monitor)
    for name in (".again", ".twice"):
        again = msgspec.structs.replace(OUT, name=name)
        harness.ask(monitor, protocol.StartTap(monitors=(again,)))
        harness.ask(player, protocol.Play(rate_hz=100.0, steps=7), protocol.Played)
        harness.ask(monitor, protocol.StopTap())
    harness.received("out", 14)
    harness.children.end([player, monitor])
    for name, child in (("player", player), ("monitor", monitor)):
        assert child.process.poll() == 0, child.log_tail()
        assert (harness.folder / f"{name}.log").read_text() == ""


@only_nightly()
@pytest.mark.parametrize("kind", ["C", "Python"])
def test_sanitizers_find_nothing_in_a_process_that_is_joined(harness: Harness, kind: str) -> None:
    try:
        files = join_object(flags=SANITIZERS), harness_library(flags=SANITIZERS)
    except BuildError as error:
        if "san" in str(error):
            pytest.skip(f"the compiler has no sanitizers here: {error}")
        raise
    joins = GraphJoins(harness.children, harness.folder, *files)
    program = [sys.executable, "-c", PYTHON_NODE] if kind == "Python" else [str(c_node("relay"))]
    node = harness.children.start(
        "node",
        "command",
        [*program, "--ros-args", "-r", f"input:={TOPIC}"],
        joins.environment("node", sanitized(harness.environment())),
        cwd=harness.folder,
        log=harness.folder / "node.log",
    )
    join = JoinPlan(player=True, monitors=("out",))
    plan = ProcessPlan(
        name="node", role="command", phase="measure", argv=tuple(program), env={}, join=join
    )
    joins.join(node, plan, HANG_S)
    player, monitor = node.parts["player"], node.parts["monitor"]
    harness.configure(player, monitor)
    joins.release()
    joins.close()
    harness.match(player, count=2)
    harness.ask(player, protocol.Play(rate_hz=100.0, steps=7), protocol.Played)
    harness.received("out", 7)
    harness.children.end([node])
    assert node.process.poll() == 0, node.log_tail()
    text = (harness.folder / "node.log").read_text()
    assert "Sanitizer" not in text, text
    assert "runtime error" not in text, text


PYTHON_NODE = """
import signal, sys, threading, rclpy
from rclpy.executors import ExternalShutdownException
from sensor_msgs.msg import Image
rclpy.init(args=sys.argv)
node = rclpy.create_node("node")
node.create_subscription(Image, "input", lambda _: None, 100)
try:
    rclpy.spin(node)
except (KeyboardInterrupt, ExternalShutdownException):
    pass
node.destroy_node()
"""


def sanitized(environment: dict[str, str]) -> dict[str, str]:
    """For a program without sanitizers, into which objects with them are loaded.

    Exceptions of the middleware need the C++ library from the beginning.
    """
    names = ("libasan.so", "libubsan.so", "libstdc++.so")
    found = [
        subprocess.run(
            [*find_compiler(), f"-print-file-name={name}"],
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        ).stdout.strip()
        for name in names
    ]
    # What is preloaded first by the harness itself allocates nothing.
    options = f"{environment['ASAN_OPTIONS']}:verify_asan_link_order=0"
    return environment | {"LD_PRELOAD": ":".join(found), "ASAN_OPTIONS": options}


def test_a_monitor_that_did_not_run_says_for_how_long(
    harness: Harness, ends: tuple[ManagedProcess, ManagedProcess]
) -> None:
    _, monitor = ends
    held = StallLogReader(harness.rows)
    os.kill(monitor.pid, signal.SIGSTOP)
    began_ns = time.monotonic_ns()
    time.sleep(0.4)
    os.kill(monitor.pid, signal.SIGCONT)
    harness.children.pump_until(lambda: held.between(began_ns, time.monotonic_ns()), HANG_S)
    assert held.between(began_ns, time.monotonic_ns()) > 0.2e9


@pytest.mark.parametrize(
    ("command", "message", "code"),
    [
        *(
            (
                protocol.ConfigureMonitor(
                    monitors=(
                        MonitorPlan(name="x", topic="/x", type=kind, match="order", qos=None),
                    ),
                    rows_dir="ROWS",
                ),
                f"message type {kind} is not installed",
                "R2B681",
            )
            for kind in ("no_such/msg/Thing", "sensor_msgs/msg/NoSuch", "sensor_msgs/Image", "")
        ),
        (
            protocol.ConfigureMonitor(monitors=(), rows_dir="/nowhere/at all"),
            "/nowhere/at all/monitor.held: No such file or directory",
            "R2B630",
        ),
    ],
)
def test_what_fails_is_said_and_the_process_ends(
    harness: Harness, command: protocol.ConfigureMonitor, message: str, code: str
) -> None:
    monitor = harness.start("monitor")
    if command.rows_dir == "ROWS":
        command = protocol.ConfigureMonitor(monitors=command.monitors, rows_dir=str(harness.rows))
    with pytest.raises(RunError, match=message) as caught:
        harness.ask(monitor, command, protocol.Ready)
    assert caught.value.code == code
    assert monitor.process.wait(HANG_S) == 1


def test_a_buffer_that_is_shorter_than_its_index_is_refused(harness: Harness) -> None:
    path = harness.buffers / "r2b%image.cdr"
    os.truncate(path, path.stat().st_size - 1)
    player = harness.start("player")
    with pytest.raises(ProcessFailedError, match="a buffer shorter than its index"):
        harness.configure_player(player)


ASKING = """
import rclpy, subprocess
rclpy.init()
print("goes on", flush=True)
subprocess.run(["printenv", "LD_PRELOAD"])
"""


def ask_over(path: str, harness: Harness, preloaded: str = "") -> subprocess.Popen[bytes]:
    """Start a program that initialises ROS and asks over a socket whether it gets parts."""
    environment = join_environment(join_object(), Path(path), "node", preloaded)
    return subprocess.Popen(
        [sys.executable, "-c", ASKING],
        env=os.environ | {"ROS_DOMAIN_ID": str(harness.domain)} | environment,
        stdout=subprocess.PIPE,
    )


@pytest.mark.parametrize("path", ["{}/none", "/" + "x" * 200], ids=["none", "long"])
def test_a_process_that_cannot_ask_goes_on(harness: Harness, path: str) -> None:
    with ask_over(path.format(harness.folder), harness) as node:
        assert node.communicate(timeout=HANG_S)[0].startswith(b"goes on\n")
    assert node.returncode == 0


def test_a_part_that_cannot_connect_is_an_error_and_the_process_goes_on(harness: Harness) -> None:
    path = str(harness.folder / "joined")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(path)
        listener.listen()
        listener.settimeout(HANG_S)
        neighbour = f"{join_object()}.none"  # the beginning of its name is that of the object
        node = ask_over(path, harness, neighbour)
        connection, _ = listener.accept()
    Path(path).unlink()
    with node, connection, connection.makefile("rb") as lines:
        connection.settimeout(HANG_S)
        assert lines.readline() == b"process node\n"
        for piece in (b"player,mon", b"itor " + os.fsencode(harness_library()), b"\n"):
            connection.sendall(piece)
            time.sleep(0.05)
        assert lines.readline() == b"failed R2B674 No such file or directory\n"
        connection.shutdown(socket.SHUT_RDWR)
        printed = node.communicate(timeout=HANG_S)[0].decode()
        assert printed == f"goes on\n{neighbour}\n"
    assert node.returncode == 0


def test_a_run_without_a_compiler_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    done = Bench(tmp_path).run(relay_spec())
    assert done.status == 2
    assert "R2B668" in done.error
    assert "no-such-compiler is not in PATH" in done.error
    assert "apt install gcc" in done.error
    assert done.run().record.processes == ()
