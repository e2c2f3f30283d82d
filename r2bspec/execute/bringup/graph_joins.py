"""Loading the harness into processes of the graph, with ``harness: {placement: graph}``.

An object is preloaded into them (``r2bspec/native/join.c``) that asks here, before a process
initialises ROS for the first time, whether it is the one that is meant. Wrappers such as
``ros2 run`` hand their environment on, so that several processes may ask for one of the plan.
"""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from r2bspec.execute.bringup.idle_nodes import IdleTime, idle_patience_s, starts_others
from r2bspec.execute.host.kernel_counters import family
from r2bspec.execute.processes.executables import build_errors, not_joinable
from r2bspec.execute.processes.supervisor import ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.ipc.native_protocol import NativeCodec
from r2bspec.native.harness_objects import harness_library, join_environment, join_object
from r2bspec.plan.plan import JoinPlan, ProcessPlan

_MAX_SOCKET_PATH: Final = 107
_BACKLOG: Final = 64
_HELLO_TIMEOUT_S: Final = 2.0
_ANSWER_TIMEOUT_S: Final = 20.0
_POLL_S: Final = 0.005
_PEER: Final = struct.Struct("3i")
"""Process, user and group, as in ``struct ucred``."""

_RCL: Final = b"/librcl.so"
_WRAPPERS: Final = ("ros2", "launch")
"""Programs that initialise ROS for themselves before they start the node."""


@dataclass(frozen=True, slots=True)
class JoinFiles:
    """What is loaded into processes of the graph."""

    join_object: Path
    library: Path


def build_join_files() -> JoinFiles:
    """Build what is loaded, unless it was.

    Raises:
        NotInstalledError: it cannot be built (R2B668).
    """
    with build_errors():
        return JoinFiles(join_object(), harness_library())


@dataclass(frozen=True, slots=True)
class Hello:
    """What is known of a process that has connected.

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


@dataclass(slots=True)
class _Asking:
    """A process that waits in its initialisation of ROS."""

    hello: Hello
    connection: socket.socket

    def go_on(self) -> None:
        """Let it initialise ROS."""
        self.connection.close()


class GraphJoins:
    """The processes of one start that get parts of the harness.

    Args:
        supervisor: of the run.
        folder: for the socket.
        files: what is loaded.
    """

    def __init__(self, supervisor: ProcessSupervisor, folder: Path, files: JoinFiles) -> None:
        self._supervisor = supervisor
        self._files = files
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
        self._asking: list[_Asking] = []
        self._connected: dict[tuple[int, str], socket.socket] = {}
        self._joined: list[_Asking] = []

    def environment(self, process: str, environment: dict[str, str]) -> dict[str, str]:
        """The environment of a process that gets parts."""
        preloaded = environment.get("LD_PRELOAD", "")
        return environment | join_environment(
            self._files.join_object, self._path, process, preloaded
        )

    def join(self, child: ManagedProcess, plan: ProcessPlan, timeout_s: float) -> None:
        """Wait until a process initialises ROS, and start its parts; it waits for `release`.

        Raises:
            NotJoinableError: it does not ask in time, or cannot load the harness.
            RunError: it has exited.
        """
        join = plan.join or JoinPlan()
        asking = self._wait_for(child, plan, timeout_s)
        self._joined.append(asking)
        wanted = {"player": join.player, "monitor": bool(join.monitors)}
        parts = [part for part, is_wanted in wanted.items() if is_wanted]
        self._start(asking, child, parts)
        for part in parts:
            connection = self._connection(child, asking.hello.pid, part)
            self._supervisor.add_joined_part(child, part, connection)

    def release(self) -> None:
        """Let all processes go on: the publishers of the harness exist."""
        for each in (*self._joined, *self._asking):
            each.go_on()
        self._joined.clear()
        self._asking.clear()

    def poll(self) -> None:
        """Accept what has connected since the last time."""
        with contextlib.suppress(BlockingIOError):
            while True:
                connection, _ = self._listener.accept()
                hello = _hello(connection)
                if hello is None:
                    connection.close()
                elif hello.part:
                    self._connected[hello.pid, hello.part] = connection
                else:
                    self._asking.append(_Asking(hello, connection))

    def close(self) -> None:
        """Listen no longer; processes that have asked in the meantime go on."""
        self.poll()
        self.release()
        self._listener.close()
        os.close(self._folder_fd)

    def _wait_for(self, child: ManagedProcess, plan: ProcessPlan, timeout_s: float) -> _Asking:
        """Wait until the process that is meant asks.

        A process that does nothing, and in which nothing has loaded ROS, is not waited for until
        the deadline; a launch file may start its nodes with a delay.
        """
        program = plan.join.program if plan.join is not None else ""
        seen: list[str] = []
        idle = IdleTime(lambda: family(child.pid))
        patience_s = timeout_s if starts_others(plan) else idle_patience_s(timeout_s)
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            self.poll()
            for each in [one for one in self._asking if one.hello.process == child.name]:
                self._asking.remove(each)
                if is_target_process(each.hello, program):
                    return each
                seen.append(" ".join(each.hello.arguments[:3]))
                each.go_on()
            if idle.update() > patience_s and not has_loaded_ros(family(child.pid)):
                raise not_joinable(
                    child.name,
                    f"none of its programs has loaded ROS, and they have been idle for "
                    f"{patience_s:.3g} s",
                )
            self._supervisor.pump(_POLL_S)
        others = f" (others did: {'; '.join(seen[:5])})" if seen else ""
        raise not_joinable(
            child.name,
            f"none of its programs {'named ' + program if program else ''}has "
            f"initialised ROS with what was preloaded{others}".replace("  ", " "),
        )

    def _start(self, asking: _Asking, child: ManagedProcess, parts: Iterable[str]) -> None:
        """Start parts in a process that waits (``join.c``).

        Raises:
            NotJoinableError: it answers that it cannot, or does not answer.
        """
        command = ",".join(parts).encode() + b" " + os.fsencode(self._files.library)
        with contextlib.suppress(OSError):
            asking.connection.sendall(command)
        asking.connection.setblocking(False)
        received = b""
        deadline = time.monotonic() + _ANSWER_TIMEOUT_S
        while not received.endswith(b"\n"):
            try:
                more = asking.connection.recv(1 << 16)
                if not more:
                    break
                received += more
            except BlockingIOError:
                if time.monotonic() > deadline:
                    break
                self._supervisor.pump(_POLL_S)
            except OSError:
                break
        asking.connection.setblocking(True)
        # A process that has exited is an error of its own.
        self._supervisor.pump(0.0)
        try:
            reply = NativeCodec().decode(received)
        except (msgspec.DecodeError, ValueError):
            raise not_joinable(child.name, "it does not load the harness") from None
        if isinstance(reply, protocol.Failed):
            raise not_joinable(child.name, reply.message)

    def _connection(self, child: ManagedProcess, pid: int, part: str) -> socket.socket:
        deadline = time.monotonic() + _ANSWER_TIMEOUT_S
        while time.monotonic() < deadline:
            self.poll()
            if (pid, part) in self._connected:
                return self._connected.pop((pid, part))
            self._supervisor.pump(_POLL_S)
        raise not_joinable(child.name, f"its {part} did not connect")


def has_loaded_ros(pids: Iterable[int]) -> bool:
    """Whether a process has loaded ROS, or may have: one whose memory cannot be looked at."""
    for pid in pids:
        try:
            if _RCL in Path(f"/proc/{pid}/maps").read_bytes():
                return True
        except FileNotFoundError:
            continue
        except OSError:
            return True
    return False


def is_target_process(hello: Hello, program: str) -> bool:
    """Whether a process that asks is the node, and no wrapper that will start it.

    Args:
        hello: what it says of itself.
        program: of a launch file, the name of the node or of its executable; else empty.
    """
    names = [Path(each).name for each in (hello.executable, *hello.arguments[:2])]
    if program:
        return program in names or f"__node:={program}" in hello.arguments
    return not any(each in names for each in _WRAPPERS)


def _hello(connection: socket.socket) -> Hello | None:
    """Who is at the other end of a connection; every one says at once for what it connects."""
    connection.settimeout(_HELLO_TIMEOUT_S)
    line = bytearray()
    with contextlib.suppress(OSError):
        # Byte by byte: what follows is for the reader of the channel.
        while not line.endswith(b"\n") and (byte := connection.recv(1)):
            line += byte
        what, _, name = line.decode(errors="replace").rstrip("\n").partition(" ")
        credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
        pid = int(_PEER.unpack(credentials)[0])
        if what == "part":
            return Hello(pid, part=name)
        if what == "process":
            return _asking_process(pid, name)
    return None


def _asking_process(pid: int, process: str) -> Hello:
    """What the kernel says of a process that waits for an answer."""
    folder = Path(f"/proc/{pid}")
    words = (folder / "cmdline").read_bytes().split(b"\0")
    return Hello(
        pid,
        process,
        executable=str((folder / "exe").readlink()),
        arguments=tuple(each.decode(errors="replace") for each in words),
    )
