"""The processes of a run: starting, receiving replies, detecting exits, and ending in order.

Everything happens in the single thread of the controller: `ProcessSupervisor.pump` waits for
messages, checks every process, and raises as soon as one has exited unexpectedly.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar

from r2bspec.errors import is_refusal
from r2bspec.execute.errors import NotInstalledError, ProcessDiedError, ProcessFailedError, RunError
from r2bspec.execute.processes.prerequisites import SharedMemoryModes
from r2bspec.execute.processes.process import (
    MAX_SIGTERM_S,
    LogLimiter,
    ManagedProcess,
    describe_exit,
    end_sequentially,
    open_log,
)
from r2bspec.ipc import protocol
from r2bspec.ipc.process_cleanup import SessionLeader, clean_up, run_processes
from r2bspec.middleware.middleware import middleware_of
from r2bspec.record.run_record import ProcessRecord
from r2bspec.safe_io.private_files import PRIVATE_UMASK

__all__ = ["ManagedProcess", "ProcessSupervisor"]

NO_ANSWER = "R2B632"
"""The code of an error because a process does not respond in time."""

_POLL_S = 0.05
REPLY_TIMEOUT_S = 10.0
"""For what a process answers at once; it may be in a callback."""

_WATCHDOG_EXIT_S = 5.0
"""The watchdog exits at once when it is told to, unless a signal has stopped it."""

_NOT_INSTALLED_PREFIX = "R2B62"
"""The codes for missing software: another attempt would not help."""

_ROLES_WITHOUT_CHANNEL = frozenset({"command", "container"})
"""Roles of programs that are not part of r2bspec."""

_Answer = TypeVar("_Answer")


class ProcessSupervisor:
    """All processes of a run, and the watchdog that ends them if the controller is killed.

    Attributes:
        lost_watchdog: whether the watchdog was not there any more when the run was closed.
    """

    lost_watchdog = False

    def __init__(
        self,
        run_id: str,
        scratch: Path,
        check_interrupt: Callable[[], None],
        on_start: Callable[[ManagedProcess], None] | None = None,
        redact: Callable[[str], str] = str,
        events: Path | None = None,
    ) -> None:
        self._redact = redact
        self._run_id = run_id
        self._check_interrupt = check_interrupt
        self._on_start = on_start
        self._selector = selectors.DefaultSelector()
        self._running: dict[str, ManagedProcess] = {}
        self._all: list[ManagedProcess] = []
        self._killed: list[str] = []
        self._logs = LogLimiter()
        self._shared_memory = SharedMemoryModes(self.pids)
        self._began_s = time.time()
        # It inherits the environment of the controller: the watchdog is not part of the run.
        self._watchdog = subprocess.Popen(
            [
                *(sys.executable, "-P", "-m", "r2bspec.harness.watchdog", run_id),
                *map(str, (scratch, events or scratch)),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def __iter__(self) -> Iterator[ManagedProcess]:
        return iter(list(self._running.values()))

    def start(
        self,
        name: str,
        role: str,
        argv: Iterable[str],
        env: dict[str, str],
        *,
        cwd: Path,
        log: Path,
        parts: Collection[str] = (),
        native: Collection[str] = (),
        umask: int = PRIVATE_UMASK,
    ) -> ManagedProcess:
        """Start a process in its own session, with its output in `log`.

        It has a control channel, and one more for each of its `parts`, unless it is not part of
        r2bspec. On channels of `native` parts, and of a native process (an empty name), messages
        are as `NativeCodec` writes them. Its `umask` keeps the shared memory of its middleware
        private.

        Raises:
            NotInstalledError: the program does not exist, or may not be executed.
            OSError: the log cannot be written.
        """
        command = list(argv)
        self._logs.watch(log.parent)
        named = () if role in _ROLES_WITHOUT_CHANNEL else ("", *parts)
        channels = {part: socket.socketpair() for part in named}
        theirs = {part: pair[1] for part, pair in channels.items()}
        env = env | {
            protocol.control_variable(part): str(socket_end.fileno())
            for part, socket_end in theirs.items()
        }
        log_start = 0
        try:
            with open_log(log) as output:
                log_start = os.fstat(output.fileno()).st_size
                process = SessionLeader(
                    command,
                    cwd=cwd,
                    env=env,
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    pass_fds=[socket_end.fileno() for socket_end in theirs.values()],
                    umask=umask,
                )
        except OSError as error:
            for ours, _ in channels.values():
                ours.close()
            if error.filename == str(log) or is_refusal(error):
                # It is not the program that is missing: the log cannot be written.
                raise
            raise NotInstalledError(
                f"process {name} cannot be started: {command[0]}: {error.strerror or error}",
                hint="Check the command in the spec, and that it is installed on this machine.",
                code="R2B621",
            ) from error
        finally:
            for end in theirs.values():
                end.close()
        self._notify_watchdog(f"session {process.pid} {process.session.started}\n")
        own_ends = {part: pair[0] for part, pair in channels.items()}
        child = ManagedProcess(
            name, role, process, log, own_ends.get(""), self._redact, native="" in native
        )
        child.log_start = log_start
        for part in parts:
            child.add_part(part, own_ends[part], native=part in native)
        for endpoint in (child, *child.parts.values()):
            if endpoint.connection is not None:
                self._selector.register(endpoint.connection, selectors.EVENT_READ, endpoint)
        self._running[name] = child
        self._all.append(child)
        if self._on_start is not None:
            self._on_start(child)
        return child

    def add_joined_part(
        self, child: ManagedProcess, part: str, connection: socket.socket
    ) -> ManagedProcess:
        """Return a part of the harness that was loaded into a process of the graph."""
        endpoint = child.add_part(part, connection, native=True)
        child.has_joined_parts = True
        self._selector.register(connection, selectors.EVENT_READ, endpoint)
        return endpoint

    def pump(self, timeout_s: float = _POLL_S) -> None:
        """Wait for messages for at most `timeout_s` seconds, and check every process.

        Raises:
            ProcessFailedError: a process reported an error.
            NotInstalledError: a process reported that something is not installed.
            ProcessDiedError: a process exited unexpectedly.
            InterruptedRunError: a signal interrupted the run.
        """
        self._check_interrupt()
        for key, _ in self._selector.select(timeout_s):
            child: ManagedProcess = key.data
            if not child.read():
                self._selector.unregister(key.fileobj)
        for child in self._running.values():
            for endpoint in (child, *child.parts.values()):
                self._raise_failure(endpoint)
        self._logs.truncate_large()
        self._shared_memory.make_private()
        for child in list(self._running.values()):
            if child.process.poll() is not None and not child.exit_expected:
                self._raise_exit(child)
        self._check_interrupt()

    def pump_for(self, seconds: float) -> None:
        """Call `pump` for a number of seconds.

        Raises:
            RunError: from `pump`.
        """
        self.pump_until(lambda: False, seconds)

    def pump_until(
        self, condition: Callable[[], object], timeout_s: float, poll_s: float = _POLL_S
    ) -> bool:
        """Call `pump` until a condition holds; False if it does not within a number of seconds.

        Raises:
            RunError: from `pump`, or from the condition.
        """
        deadline = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            self.pump(poll_s)
        return True

    def _raise_failure(self, child: ManagedProcess) -> None:
        for message in child.inbox:
            if isinstance(message, protocol.Failed):
                missing = message.code.startswith(_NOT_INSTALLED_PREFIX)
                raise (NotInstalledError if missing else ProcessFailedError)(
                    f"{child.name}: {self._redact(message.message)}",
                    hint=self._redact(message.hint) or f"Its output is in {child.log}.",
                    code=message.code,
                    blamed=child.name,
                )

    def _raise_exit(self, child: ManagedProcess) -> None:
        # Its last reply may still be in the socket.
        for endpoint in (child, *child.parts.values()):
            if endpoint.read():
                self._raise_failure(endpoint)
        output = child.last_output()
        raise ProcessDiedError(
            f"process {child.name} {describe_exit(child.process.returncode)}{output}",
            hint=f"Its complete output is in {child.log}.",
            process=child.name,
            output=child.log_tail(),
        )

    def request(
        self,
        child: ManagedProcess,
        command: Any,
        kind: type[_Answer],
        timeout_s: float = REPLY_TIMEOUT_S,
    ) -> _Answer:
        """Send a command and wait for its reply.

        Raises:
            RunError: no reply was received in time, or from `pump`.
        """
        child.send(command)
        return self.answer(child, kind, timeout_s)

    def ask_observer(
        self, command: Any, kind: type[_Answer], timeout_s: float = REPLY_TIMEOUT_S
    ) -> _Answer:
        """Send a command to a process that reports what discovery shows: observer or loader."""
        observer = next(child for child in self if child.role in {"observer", "loader"})
        return self.request(observer, command, kind, timeout_s)

    def answer(
        self,
        child: ManagedProcess,
        kind: type[_Answer],
        timeout_s: float,
        stated_timeout_s: float | None = None,
    ) -> _Answer:
        """Wait for a reply of a type.

        Args:
            child: whose reply it is.
            kind: its type.
            timeout_s: how long to wait.
            stated_timeout_s: the timeout in the error, if `timeout_s` is only the rest of it.

        Raises:
            RunError: none was received in time, or from `pump`.
        """
        deadline = time.monotonic() + timeout_s
        while True:
            while child.inbox:
                message = child.inbox.popleft()
                if isinstance(message, kind):
                    return message
            if time.monotonic() > deadline:
                stated_s = timeout_s if stated_timeout_s is None else stated_timeout_s
                raise RunError(
                    f"process {child.name} did not respond within {stated_s:g} s"
                    f"{child.last_output()}",
                    hint=f"It may be blocked in a callback or a constructor; see {child.log}",
                    code=NO_ANSWER,
                    blamed=child.name,
                )
            self.pump()

    def end(self, children: Iterable[ManagedProcess]) -> None:
        """End some processes, one after another; see `shutdown`."""
        ended = [child for child in children if child.name in self._running]
        in_turn_s = middleware_of(os.environ).exit_in_turn_s
        self._killed += end_sequentially(ended, self._logs.truncate_large, in_turn_s)
        for child in ended:
            self._forget(child)

    def close(self) -> list[str]:
        """End all processes, clean up, and return the names of processes that had to be killed."""
        self.end(list(self._running.values()))
        sessions = [child.session for child in self._all]
        self._killed += clean_up(
            self._run_id, sessions, grace_s=MAX_SIGTERM_S, since_s=self._began_s - 1.0
        )
        self.lost_watchdog = self._watchdog.poll() is not None
        self._notify_watchdog("done\n")
        with contextlib.suppress(OSError):
            if self._watchdog.stdin is not None:
                self._watchdog.stdin.close()
        try:
            self._watchdog.wait(_WATCHDOG_EXIT_S)
        except subprocess.TimeoutExpired:
            self._watchdog.kill()
            self._watchdog.wait()
        self._selector.close()
        self._logs.truncate_large(now=True)
        return self._killed

    @property
    def truncated_logs(self) -> list[Path]:
        """The logs that were truncated."""
        return self._logs.truncated

    def pids(self) -> frozenset[int]:
        """Return the started processes of the run, and their running descendants."""
        started = {child.pid for child in self._all}
        living = run_processes(self._run_id, [child.session for child in self._all])
        return frozenset(started | {process.pid for process in living})

    def records(self) -> tuple[ProcessRecord, ...]:
        """Return every process that was started, with its exit status."""
        return tuple(
            ProcessRecord(
                name=child.name,
                role=child.role,
                pid=child.pid,
                exit_code=child.process.poll(),
                signals=tuple(child.signals),
                parts=tuple(child.parts) if child.has_joined_parts else (),
                scheduling=child.scheduling,
            )
            for child in self._all
        )

    def _forget(self, child: ManagedProcess) -> None:
        del self._running[child.name]
        session = child.session
        if session.held is not None:
            self._notify_watchdog(f"collected {session.pid} {session.held}\n")
        for endpoint in (child, *child.parts.values()):
            if endpoint.connection is not None:
                with contextlib.suppress(KeyError, ValueError):
                    self._selector.unregister(endpoint.connection)
                endpoint.connection.close()

    def _notify_watchdog(self, line: str) -> None:
        if self._watchdog.stdin is not None:
            with contextlib.suppress(OSError):
                self._watchdog.stdin.write(line.encode())
                self._watchdog.stdin.flush()
