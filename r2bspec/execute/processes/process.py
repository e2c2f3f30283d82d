"""One process of a run, as the controller sees it: its channel, its output, and its end.

Processes end one after another: by request, then with SIGTERM, then with SIGKILL. Logs are
truncated, so that no process can fill the disk. CPUs, priority and time slice are set when a
process has just been started.
"""

from __future__ import annotations

import contextlib
import ctypes
import io
import os
import platform
import signal
import socket
import stat
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Final

import msgspec

from r2bspec.errors import OUTPUT_FOLLOWS
from r2bspec.ipc import protocol
from r2bspec.ipc.native_protocol import NativeCodec
from r2bspec.ipc.process_cleanup import ProcessSession, SessionLeader, kill_process_groups
from r2bspec.record.run_record import ThreadSchedulingRecord

MAX_LOG_BYTES = 32 << 20
"""Larger logs are truncated."""

KEPT_HEAD_BYTES = 8 << 20
KEPT_TAIL_BYTES = 8 << 20
"""The parts of a truncated log that are kept: its beginning and its end."""

_PERIOD_S = 0.1


class LogLimiter:
    """Limits the size of all files in the log folders of a run.

    Processes write to their logs directly, so that none waits for the controller to read its
    output. The middle of a large log is removed later: each log is opened for appending, so that
    its process continues at the new end.
    """

    def __init__(self) -> None:
        self._folders: set[Path] = set()
        self._removed_bytes: dict[Path, int] = {}
        self._next_s = 0.0

    @property
    def truncated(self) -> list[Path]:
        """The logs that were truncated."""
        return sorted(self._removed_bytes)

    def watch(self, folder: Path) -> None:
        """Limit the logs in a folder and its subfolders."""
        self._folders.add(folder)

    def truncate_large(self, *, now: bool = False) -> None:
        """Truncate large logs; checks at most every tenth of a second, unless `now`.

        A log that cannot be truncated stays unchanged.
        """
        if not now and time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + _PERIOD_S
        for log in (path for folder in self._folders for path in folder.rglob("*")):
            # A node may write there, too, and remove what it has written.
            with contextlib.suppress(OSError):
                status = log.lstat()
                # No link of either kind: the file may be elsewhere, too.
                if status.st_size > MAX_LOG_BYTES and _is_own_file(status):
                    with log.open("ab+", buffering=0) as file:
                        self._truncate(log, file)

    def _truncate(self, log: Path, file: io.FileIO) -> None:
        size = file.seek(0, os.SEEK_END)
        file.seek(size - KEPT_TAIL_BYTES)
        tail = file.read(KEPT_TAIL_BYTES) or b""
        file.truncate(KEPT_HEAD_BYTES)
        # What earlier cuts took out is counted; their notes were cut out with the rest.
        cut_bytes = self._removed_bytes.get(log, 0) + size - KEPT_HEAD_BYTES - KEPT_TAIL_BYTES
        self._removed_bytes[log] = cut_bytes
        note = f"\n[r2bspec removed {cut_bytes / 2**20:.1f} MiB of this log here]\n"
        file.write(note.encode() + tail)


def open_log(log: Path) -> BinaryIO:
    """Open a log for appending; no other user may read it, and a link in its place is refused.

    Raises:
        OSError: it cannot be opened.
    """
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
    return os.fdopen(os.open(log, flags, 0o600), "ab")


def _is_own_file(status: os.stat_result) -> bool:
    return stat.S_ISREG(status.st_mode) and status.st_nlink == 1


SLICE_NS: Final = 500_000
"""Less than the kernel's default, which is 1.4 ms on two cores and more on larger machines, and
longer than most of what player and monitor do for one message."""

_SCHED_OTHER: Final = 0
_SYSCALLS: Final = {"x86_64": (314, 315), "aarch64": (274, 275)}
"""sched_setattr and sched_getattr, which neither Python nor glibc before 2.41 can call."""


class _SchedAttr(ctypes.Structure):
    """struct sched_attr of linux/sched/types.h, in its first version."""

    _fields_ = (
        ("size", ctypes.c_uint32),
        ("policy", ctypes.c_uint32),
        ("flags", ctypes.c_uint64),
        ("nice", ctypes.c_int32),
        ("priority", ctypes.c_uint32),
        ("runtime_ns", ctypes.c_uint64),
        ("deadline_ns", ctypes.c_uint64),
        ("period_ns", ctypes.c_uint64),
    )


def shorten_slice(pid: int) -> bool:
    """Give a process that has just been started `SLICE_NS`, so that it waits less for a core.

    Since Linux 6.12 a thread that wakes up preempts a thread with a longer slice if its turn comes
    earlier (EEVDF); otherwise it waits until that slice is over, which shows as late publications
    and arrivals. The share of the processor of each thread does not change. Threads and descendants
    inherit it. No privilege is needed. Earlier kernels ignore it, and a real-time policy has no
    slices: neither is an error.

    Args:
        pid: the process, before it starts threads.

    Returns:
        Whether the kernel has accepted it.
    """
    attributes = _attributes(pid)
    if attributes is None or attributes.policy != _SCHED_OTHER:
        return False
    attributes.runtime_ns = SLICE_NS
    set_call, _ = _SYSCALLS[platform.machine()]
    return _syscall(set_call, pid, ctypes.byref(attributes), 0) == 0


def slice_of(pid: int) -> int:
    """Return the time slice of a process, in nanoseconds; 0 if the kernel does not tell."""
    attributes = _attributes(pid)
    return 0 if attributes is None else int(attributes.runtime_ns)


def _attributes(pid: int) -> _SchedAttr | None:
    attributes = _SchedAttr(size=ctypes.sizeof(_SchedAttr))
    calls = _SYSCALLS.get(platform.machine())
    if calls is None or _syscall(calls[1], pid, ctypes.byref(attributes), attributes.size, 0) != 0:
        return None
    return attributes


def _syscall(number: int, pid: int, *arguments: object) -> int:
    return int(ctypes.CDLL(None).syscall(number, pid, *arguments))


_SEND_TIMEOUT_S = 10.0
_PART_EXIT_S = 2.0
"""How long a part in a process of the graph may take to end; a blocked one ends with it."""

_LOG_TAIL_LINES = 12
_LOG_TAIL_BYTES = 8192
_LONGEST_SECRET_BYTES = 1 << 17
"""The kernel allows no longer variable."""

MAX_EXIT_S = 10.0
"""How long a process may take to exit after the request."""

MAX_SIGTERM_S = 2.0
"""How long a process may take to exit after SIGTERM."""

_MAX_SIGKILL_S = 5.0
_POLL_S = 0.005


class ManagedProcess:
    """One process, or a part of one that has its own control channel.

    Programs that are not part of r2bspec have no channel. On a `native` one, messages are as
    `NativeCodec` writes them.

    Attributes:
        parts: those of a harness process, by their roles. A part is started, supervised and ended
            with its process.
        inbox: replies that have been received but not processed.
        exit_expected: whether its exit is not an error, because it was told to exit or is a
            command.
        has_replied: whether it has ever sent a reply.
        log_start: the size of its log, in bytes, when it was started: what an earlier process of
            this name has written.
        signals: those that the run has sent to it.
        has_joined_parts: whether its `parts` were loaded into a process of the graph.
    """

    def __init__(
        self,
        name: str,
        role: str,
        process: SessionLeader,
        log: Path,
        connection: socket.socket | None = None,
        redact: Callable[[str], str] = str,
        *,
        native: bool = False,
    ) -> None:
        self.name = name
        self.role = role
        self.process = process
        self.log = log
        self.connection = connection
        self.inbox: deque[Any] = deque()
        self.exit_expected = False
        self.has_replied = False
        self.log_start = 0
        self.parts: dict[str, ManagedProcess] = {}
        self.signals: list[int] = []
        self.scheduling: tuple[ThreadSchedulingRecord, ...] = ()
        codec = NativeCodec()
        self._encode: Callable[[Any], bytes] = codec.encode if native else protocol.encode
        self._decode: Callable[[bytes], Any] = codec.decode if native else protocol.decode_reply
        self.has_joined_parts = False
        self._redact = redact
        self._pending = bytearray()

    def add_part(self, part: str, connection: socket.socket, *, native: bool) -> ManagedProcess:
        """Add a part that has its own control channel."""
        process = self.process
        added = ManagedProcess(
            part, part, process, self.log, connection, self._redact, native=native
        )
        self.parts[part] = added
        return added

    @property
    def pid(self) -> int:
        """The process id, which is also the id of its session and process group."""
        return self.process.pid

    @property
    def is_running(self) -> bool:
        """Whether it has not exited yet."""
        return self.process.poll() is None

    @property
    def session(self) -> ProcessSession:
        """The id of the session that it opened."""
        return self.process.session

    def send(self, message: Any) -> None:
        """Send a command.

        Errors of the channel are ignored, because `pump` detects an exited or blocked child.

        Raises:
            OSError: a file that belongs to the command cannot be written.
        """
        if self.connection is not None:
            line = self._encode(message)
            with contextlib.suppress(OSError):
                self.connection.settimeout(_SEND_TIMEOUT_S)
                self.connection.sendall(line)

    def read(self) -> bool:
        """Move received replies to the inbox; False at the end of the channel."""
        if self.connection is None:
            return False
        try:
            # The channel may stay open after the child has exited, if a fork has inherited it.
            self.connection.setblocking(False)
            received = self.connection.recv(1 << 16)
        except BlockingIOError:
            return True
        except OSError:
            return False
        self._pending += received
        *lines, rest = self._pending.split(b"\n")
        self._pending = bytearray(rest)
        for line in lines:
            # Other data that a node may write to this socket by mistake is ignored.
            with contextlib.suppress(msgspec.DecodeError, ValueError):
                self.inbox.append(self._decode(bytes(line)))
                self.has_replied = True
        return bool(received)

    def request_shutdown(self) -> None:
        """Ask it to exit: over its channel, or with SIGINT."""
        self.exit_expected = True
        self._end_parts()
        self.send(protocol.Shutdown())
        if self.connection is None:
            self.signal(signal.SIGINT)
        elif not self.has_replied:
            # It is still initialising, or blocked in it: it reads no commands yet, and has nothing
            # to clean up.
            self.signal(signal.SIGTERM)

    def _end_parts(self) -> None:
        """End the parts of the harness, so that the process exits as it does without them."""
        for part in self.parts.values():
            part.send(protocol.Shutdown())
        for part in self.parts.values():
            with contextlib.suppress(OSError):
                if part.connection is not None:
                    part.connection.settimeout(_PART_EXIT_S)
                    while part.connection.recv(1 << 16):
                        pass

    def signal(self, which: signal.Signals) -> None:
        """Send a signal to its whole process group, unless it has ended and been collected."""
        if not self.is_running:
            # Its number may be that of another group by now.
            return
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, which)
            self.signals.append(int(which))

    def log_tail(self) -> str:
        """Return the last lines of its output, with secrets redacted.

        More is read than is returned: a secret is complete, and is replaced, before the text is
        cut.
        """
        try:
            with self.log.open("rb") as file:
                file.seek(0, 2)
                file.seek(max(0, file.tell() - _LOG_TAIL_BYTES - _LONGEST_SECRET_BYTES))
                text = file.read().decode(errors="replace")
        except OSError:
            return ""
        return "\n".join(self._redact(text)[-_LOG_TAIL_BYTES:].splitlines()[-_LOG_TAIL_LINES:])

    def last_output(self) -> str:
        """Return the last lines of its output, as the end of a sentence."""
        tail = self.log_tail()
        return f"{OUTPUT_FOLLOWS}{tail}" if tail else "; it printed nothing"


def describe_exit(status: int) -> str:
    """Return the text for a return code of `subprocess`."""
    if status >= 0:
        return f"exited with status {status}"
    with contextlib.suppress(ValueError):
        return f"was killed by {signal.Signals(-status).name}"
    return f"was killed by signal {-status}"


def end_sequentially(
    processes: Sequence[ManagedProcess], on_poll: Callable[[], None], in_turn_s: float
) -> list[str]:
    """End processes one after another.

    Args:
        processes: in the order in which to end them.
        on_poll: is called repeatedly while waiting.
        in_turn_s: how long processes are waited for one by one, all together; then the rest are
            asked at once (`Middleware.exit_in_turn_s`).

    Returns:
        The names of those that had to be killed.
    """
    began = time.monotonic()
    for child in processes:
        child.request_shutdown()
        _wait_for([child], began + in_turn_s, on_poll)
    # A harness process whose middleware hangs ends by itself within this time from its request.
    _wait_for(processes, time.monotonic() + MAX_EXIT_S, on_poll)
    _signal_all(processes, signal.SIGTERM)
    _wait_for(processes, time.monotonic() + MAX_SIGTERM_S, on_poll)
    killed = _signal_all(processes, signal.SIGKILL)
    _wait_for(processes, time.monotonic() + _MAX_SIGKILL_S, on_poll)
    # Grandchildren in the group that outlived their parent.
    kill_process_groups([child.session for child in processes])
    return killed


def _wait_for(
    processes: Sequence[ManagedProcess], deadline_s: float, on_poll: Callable[[], None]
) -> None:
    while any(child.is_running for child in processes) and time.monotonic() < deadline_s:
        on_poll()
        time.sleep(_POLL_S)


def _signal_all(processes: Sequence[ManagedProcess], which: signal.Signals) -> list[str]:
    """Send a signal to those that still run; returns their names."""
    running = [child for child in processes if child.is_running]
    for child in running:
        child.signal(which)
    return [child.name for child in running]
