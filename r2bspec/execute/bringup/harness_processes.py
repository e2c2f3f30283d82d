"""The player and the monitors, and the processes in which they run.

A plan gives player and monitor a process each, or one for both (role `harness`), in which Python
nodes may also run. With ``placement: graph`` they are parts of processes of the graph: each of
these waits in its initialisation of ROS until its parts are configured, so that the publishers of
the inputs are older than every node, and monitors in several processes are commanded as one. The
rest of the controller addresses a part and does not know its process.

An object is preloaded into these (``r2bspec/native/join.c``) that asks here, before a process
initialises ROS for the first time, whether it is the one that is meant. Wrappers such as
``ros2 run`` hand their environment on, so that several processes may ask for one of the plan.
"""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import msgspec

from r2bspec.execute.bringup.launcher import Launcher
from r2bspec.execute.bringup.readiness import IdleTime
from r2bspec.execute.errors import NotJoinableError
from r2bspec.execute.processes.resources import family
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.ipc.native_protocol import NativeCodec
from r2bspec.native.build import join_environment
from r2bspec.plan.plan import JoinPlan, MonitorPlan, Plan, ProcessPlan

_MAX_SOCKET_PATH: Final = 107
_BACKLOG: Final = 64
_HELLO_TIMEOUT_S: Final = 2.0
_MAX_HELLO: Final = 1024
"""Bytes of the line that a process sends, as in ``join.c``."""

_ANSWER_TIMEOUT_S: Final = 20.0
_POLL_S: Final = 0.005
_SETTLED_S: Final = 1.0
"""For how long nothing of a process does anything before all of its programs have started."""

_PEER: Final = struct.Struct("3i")
"""Process, user and group, as in ``struct ucred``."""

_WRAPPERS: Final = ("ros2", "launch")
"""Programs that initialise ROS for themselves before they start the node."""


@dataclass(frozen=True, slots=True)
class Hello:
    """What a process says of itself when it connects.

    Attributes:
        pid: its id.
        process: the process of the plan that it belongs to, if it asks whether it gets parts.
        part: the part that it connects, otherwise.
        executable: its program.
        arguments: its command line.
    """

    pid: int
    process: str = ""
    part: str = ""
    executable: str = ""
    arguments: tuple[str, ...] = ()


class GraphJoins:
    """The processes of one start that get parts of the harness.

    Args:
        supervisor: the supervisor of the run.
        folder: for the socket.
        preload: the object that is loaded into them.
        library: the harness, which that loads.
    """

    def __init__(
        self, supervisor: ProcessSupervisor, folder: Path, preload: Path, library: Path
    ) -> None:
        self._supervisor = supervisor
        self._preload, self._library = preload, library
        self._listener = socket.socket(socket.AF_UNIX)
        self._folder_fd = os.open(folder, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
        path = folder / "join.socket"
        # A path that is too long for a socket is reached through a descriptor of its folder.
        self._path = (
            path
            if len(os.fsencode(path)) <= _MAX_SOCKET_PATH
            else Path(f"/proc/{os.getpid()}/fd/{self._folder_fd}/{path.name}")
        )
        self._listener.bind(str(self._path))
        self._listener.listen(_BACKLOG)
        self._listener.setblocking(False)
        # What waits in its initialisation of ROS until its connection is closed.
        self._asking: list[tuple[Hello, socket.socket]] = []
        self._joined: list[socket.socket] = []
        self._connected: dict[tuple[int, str], socket.socket] = {}

    def environment(self, process: str, environment: dict[str, str]) -> dict[str, str]:
        """Return the environment of a process that parts of the harness join."""
        preloaded = environment.get("LD_PRELOAD", "")
        return environment | join_environment(self._preload, self._path, process, preloaded)

    def join(self, child: ManagedProcess, plan: ProcessPlan, timeout_s: float) -> None:
        """Wait until a process initialises ROS, and start its parts; it waits for `release`.

        Raises:
            NotJoinableError: it does not ask in time, or cannot load the harness.
            RunError: it has exited.
        """
        join = plan.join or JoinPlan()
        hello, waiting = self._wait_for(child, plan, timeout_s)
        self._joined.append(waiting)
        parts = ["player"] if join.player else []
        parts += ["monitor"] if join.monitors else []
        self._start(waiting, child, parts)
        for part in parts:
            key = hello.pid, part
            deadline = time.monotonic() + _ANSWER_TIMEOUT_S
            while key not in self._connected:
                if time.monotonic() > deadline:
                    raise not_joinable(child.name, f"its {part} did not connect")
                self._supervisor.pump(_POLL_S)
                self.poll()
            self._supervisor.add_joined_part(child, part, self._connected.pop(key))

    def release(self) -> None:
        """Let all processes continue: the publishers of the harness exist."""
        for connection in (*self._joined, *(connection for _, connection in self._asking)):
            connection.close()
        self._joined.clear()
        self._asking.clear()

    def poll(self) -> None:
        """Accept the connections that have arrived since the last call."""
        with contextlib.suppress(BlockingIOError):
            while True:
                connection, _ = self._listener.accept()
                hello = _hello(connection)
                if hello is None:
                    connection.close()
                elif hello.part:
                    self._connected[hello.pid, hello.part] = connection
                else:
                    self._asking.append((hello, connection))

    def close(self) -> None:
        """Stop listening; processes that have asked in the meantime continue."""
        self.poll()
        self.release()
        # Parts that nobody has asked for.
        for connection in self._connected.values():
            connection.close()
        self._listener.close()
        os.close(self._folder_fd)

    def _wait_for(
        self, child: ManagedProcess, plan: ProcessPlan, timeout_s: float
    ) -> tuple[Hello, socket.socket]:
        """Wait until the process that is meant asks."""
        program = plan.join.program if plan.join is not None else ""
        seen: list[str] = []
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            self.poll()
            for hello, connection in [
                pair for pair in self._asking if pair[0].process == child.name
            ]:
                is_target = is_target_process(hello, program)
                if is_target and not program:
                    self._require_one_program(child, hello)
                self._asking.remove((hello, connection))
                if is_target:
                    return hello, connection
                seen.append(" ".join(hello.arguments[:3]))
                connection.close()
            self._supervisor.pump(_POLL_S)
        others = f" (others did: {'; '.join(seen[:5])})" if seen else ""
        raise not_joinable(
            child.name,
            f"none of its programs {'named ' + program if program else ''}has "
            f"initialised ROS with the preloaded library{others}".replace("  ", " "),
        )

    def _require_one_program(self, child: ManagedProcess, first: Hello) -> None:
        """Check that no other program of a process asks, too, while the first one waits.

        Where the inputs are read is not known before they have gone on, which is too late.

        Raises:
            NotJoinableError: one does.
            RunError: the process has exited.
        """
        idle = IdleTime(lambda: family(child.pid))
        deadline = time.monotonic() + _ANSWER_TIMEOUT_S
        while {*family(child.pid)} - {first.pid} and time.monotonic() < deadline:
            self.poll()
            others = [
                hello
                for hello, _ in self._asking
                if hello.process == child.name
                and hello is not first
                and is_target_process(hello, "")
            ]
            if others:
                names = sorted({program_name(hello) for hello in (first, *others)})
                raise not_joinable(
                    child.name,
                    f"it starts several programs that use ROS: {', '.join(names)}, and more may "
                    "follow",
                    "Name the program that reads the inputs, and publishes the topics of monitors, "
                    f"with 'in: {child.name}/{names[0]}', for example; or start the programs as "
                    "nodes of their own, or write 'harness: {placement: separate}'.",
                )
            if idle.update() > _SETTLED_S:
                break
            self._supervisor.pump(_POLL_S)

    def _start(
        self, connection: socket.socket, child: ManagedProcess, parts: Iterable[str]
    ) -> None:
        """Start parts in a process that waits (``join.c``).

        Raises:
            NotJoinableError: it answers that it cannot, or does not answer.
        """
        command = ",".join(parts).encode() + b" " + os.fsencode(self._library) + b"\n"
        with contextlib.suppress(OSError):
            connection.sendall(command)
        connection.setblocking(False)
        received = b""

        def is_answered() -> bool:
            nonlocal received
            try:
                more = connection.recv(1 << 16)
            except BlockingIOError:
                return False
            except OSError:
                return True
            received += more
            return not more or received.endswith(b"\n")

        self._supervisor.pump_until(is_answered, _ANSWER_TIMEOUT_S, _POLL_S)
        connection.setblocking(True)
        # A process that has exited is an error of its own.
        self._supervisor.pump(0.0)
        try:
            reply = NativeCodec().decode(received)
        except (msgspec.DecodeError, ValueError):
            raise not_joinable(child.name, "it does not load the harness") from None
        if isinstance(reply, protocol.Failed):
            raise not_joinable(child.name, reply.message)


def not_joinable(name: str, reason: str, hint: str = "") -> NotJoinableError:
    """Return the error for a process that the harness cannot join, with the ways out."""
    return NotJoinableError(
        f"player and monitors cannot join process {name}: {reason}",
        blamed=name,
        hint=hint
        or "A program that is linked statically, runs as another user (setuid) or uses another C "
        "library loads nothing. Write 'harness: {placement: separate}', or name another process "
        "with 'in'.",
    )


def is_target_process(hello: Hello, program: str) -> bool:
    """Return True if the process is the node itself, not a launcher.

    Args:
        hello: what it says of itself.
        program: of a launch file, the name of the node or of its executable; else empty.
    """
    names = [Path(word).name for word in (hello.executable, *hello.arguments[:2])]
    if program:
        return program in names or f"__node:={program}" in hello.arguments
    return not any(wrapper in names for wrapper in _WRAPPERS)


def program_name(hello: Hello) -> str:
    """Return the name by which `is_target_process` recognises a program: its node's, or its own."""
    for word in hello.arguments:
        if word.startswith("__node:="):
            return word.removeprefix("__node:=")
    runs_script = "python" in Path(hello.executable).name and len(hello.arguments) > 1
    return Path(hello.arguments[1] if runs_script else hello.executable).name


def _hello(connection: socket.socket) -> Hello | None:
    """Who is at the other end of a connection; every one says at once for what it connects."""
    connection.settimeout(_HELLO_TIMEOUT_S)
    line = bytearray()
    with contextlib.suppress(OSError):
        # Byte by byte: what follows is for the reader of the channel.
        while len(line) < _MAX_HELLO and not line.endswith(b"\n") and (byte := connection.recv(1)):
            line += byte
        what, _, name = line.decode(errors="replace").rstrip("\n").partition(" ")
        credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
        pid = int(_PEER.unpack(credentials)[0])
        if what == "part":
            return Hello(pid, part=name)
        if what == "process":
            # The kernel says what waits for an answer.
            words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
            return Hello(
                pid,
                process=name,
                executable=str(Path(f"/proc/{pid}/exe").readlink()),
                arguments=tuple(word.decode(errors="replace") for word in words),
            )
    return None


HarnessRole = Literal["player", "caller", "monitor", "harness"]
_PARTS: Final[tuple[HarnessRole, ...]] = ("player", "monitor")


class HarnessProcesses:
    """Starts each part, and its process if necessary, on request.

    Args:
        launcher: starts the processes.
        processes: the process plans of one phase.
    """

    def __init__(self, launcher: Launcher, processes: Iterable[ProcessPlan]) -> None:
        self._launcher = launcher
        self._plans = {
            process.role: process
            for process in processes
            if process.role in {*_PARTS, "caller", "harness"}
        }
        self._process: ManagedProcess | None = None

    def start(self, part: str) -> ManagedProcess:
        """Start a part, which then waits for its configuration.

        Raises:
            RunError: its process cannot be started, or does not respond.
        """
        if part in self._plans:
            return self._launcher.start(self._plans[part])
        return self._harness_process().parts[part]

    def node_hosts(self) -> list[tuple[ManagedProcess, ProcessPlan]]:
        """Return the common process of the parts, with its plan, if nodes run in it.

        The list is empty otherwise.
        """
        plan = self._plans.get("harness")
        return [(self._harness_process(), plan)] if plan is not None and plan.nodes else []

    def _harness_process(self) -> ManagedProcess:
        if self._process is None:
            self._process = self._launcher.start(self._plans["harness"], _PARTS)
            self._launcher.configure(self._process, protocol.ConfigureHarness(parts=_PARTS))
        return self._process


@dataclass
class GraphHarness:
    """The parts that have been loaded into processes of the graph.

    Args:
        launcher: the launcher of the processes.
        plan: the plan of the run.
        configure_player: makes the player play the inputs.
        rows_dir: receives the rows of monitors.

    Attributes:
        player: None until its process has been joined, and in a live run.
    """

    launcher: Launcher
    plan: Plan
    configure_player: Callable[[ManagedProcess], None]
    rows_dir: Path
    _monitors: list[tuple[ManagedProcess, frozenset[str]]] = field(default_factory=list)
    player: ManagedProcess | None = None

    def __post_init__(self) -> None:
        self._plans = {monitor.name: monitor for monitor in self.plan.monitors}

    def configure(self, child: ManagedProcess, plan: ProcessPlan) -> None:
        """Configure the parts of one process.

        Raises:
            RunError: a part does not respond, or exited.
        """
        if "player" in child.parts:
            self.player = child.parts["player"]
            self.configure_player(self.player)
        if "monitor" in child.parts and plan.join is not None:
            monitor = child.parts["monitor"]
            watched = tuple(self._plans[name] for name in plan.join.monitors)
            rows_dir = str(self._folder_of(watched))
            settings = protocol.ConfigureMonitor(monitors=watched, rows_dir=rows_dir)
            self.launcher.configure(monitor, settings)
            self._monitors.append((monitor, frozenset(plan.name for plan in watched)))

    def _folder_of(self, monitors: Iterable[MonitorPlan]) -> Path:
        """Return the folder that a process writes to; further processes have their own."""
        if not self._monitors:
            return self.rows_dir
        folder = self.rows_dir / f"monitor-{len(self._monitors) + 1}"
        folder.mkdir()
        for monitor in monitors:
            rows = f"{monitor.name}.rows"
            (self.rows_dir / rows).symlink_to(folder / rows)
        return folder

    @property
    def monitor(self) -> ManagedProcess:
        """All monitors, commanded as one."""
        return self._monitors[0][0] if len(self._monitors) == 1 else MonitorGroup(self._monitors)


class MonitorGroup(ManagedProcess):
    """Sends commands to all monitors, and combines their answers.

    Topics that are recorded only for a while (`protocol.StartTap`) are recorded by the first
    monitor.

    Args:
        members: the monitors, each with the names of its topics; they have been configured.
    """

    def __init__(self, members: Sequence[tuple[ManagedProcess, frozenset[str]]]) -> None:
        first = members[0][0]
        super().__init__(first.name, first.role, first.process, first.log, None)
        self._members = list(members)
        self._asked = 0
        self._matched: list[protocol.Matched] = []
        for member, _ in self._members:
            member.inbox = _Forwarding(self, member)

    def send(self, message: Any) -> None:
        """Send a command to the monitors that it concerns."""
        commands: dict[ManagedProcess, Any]
        if isinstance(message, protocol.StartTap | protocol.StopTap):
            commands = {self._members[0][0]: message}
        elif isinstance(message, protocol.Subscribe):
            commands = {}
            for member, names in self._members:
                if own := tuple(monitor for monitor in message.monitors if monitor.name in names):
                    commands[member] = protocol.Subscribe(monitors=own)
        else:
            commands = {member: message for member, _ in self._members}
        self._asked = len(commands)
        self._matched.clear()
        for member, command in commands.items():
            member.send(command)

    def collect(self, matched: protocol.Matched) -> None:
        """Take the answer of one monitor; with the last of them, the answer is complete."""
        self._matched.append(matched)
        if len(self._matched) == self._asked:
            counts = {
                topic: count for match in self._matched for topic, count in match.counts.items()
            }
            self.inbox.append(protocol.Matched(counts=counts))


class _Forwarding(deque[Any]):
    """The inbox of a member: answers go to the group, errors stay."""

    def __init__(self, group: MonitorGroup, member: ManagedProcess) -> None:
        super().__init__(member.inbox)
        self._group = group

    def append(self, message: Any) -> None:
        if isinstance(message, protocol.Matched):
            self._group.collect(message)
        else:
            super().append(message)
