"""One process of a run, as the controller sees it: its channel, its output, and its end.

Processes end one after another: by request, then with SIGTERM, then with SIGKILL.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from r2bspec.ipc import protocol
from r2bspec.ipc.native_protocol import NativeCodec
from r2bspec.ipc.process_cleanup import Session, SessionLeader, kill_process_groups

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

    Programs that are not part of r2bspec have no channel.

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
        connection: socket.socket | None,
        redact: Callable[[str], str] = str,
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
        self._encode: Callable[[Any], bytes] = protocol.encode
        self._decode: Callable[[bytes], Any] = protocol.decode_reply
        self.has_joined_parts = False
        self._redact = redact
        self._pending = bytearray()

    def use_native_protocol(self) -> None:
        """Write commands and read replies as `NativeCodec` does."""
        codec = NativeCodec()
        self._encode, self._decode = codec.encode, codec.decode

    @property
    def pid(self) -> int:
        """The process id, which is also the id of its session and process group."""
        return self.process.pid

    @property
    def is_running(self) -> bool:
        """Whether it has not exited yet."""
        return self.process.poll() is None

    @property
    def session(self) -> Session:
        """The session that it opened."""
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
        """The last lines of its output, with secrets redacted.

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


def describe_exit(status: int) -> str:
    """The text for a return code of `subprocess`."""
    if status >= 0:
        return f"exited with status {status}"
    with contextlib.suppress(ValueError):
        return f"was killed by {signal.Signals(-status).name}"
    return f"was killed by signal {-status}"


def end_sequentially(
    processes: Sequence[ManagedProcess], on_poll: Callable[[], None], in_turn_s: float
) -> list[str]:
    """End some processes.

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
    _wait_for(processes, began + MAX_EXIT_S, on_poll)
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
