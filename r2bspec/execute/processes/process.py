"""One process of a run, as the controller sees it."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from r2bspec.ipc import protocol
from r2bspec.ipc.sessions import Session, SessionLeader

_SEND_TIMEOUT_S = 10.0
_LOG_TAIL_LINES = 12
_LOG_TAIL_BYTES = 8192


class ManagedProcess:
    """One process, or a part of one that has a control channel of its own.

    Programs that know nothing of r2bspec have no channel.

    Attributes:
        parts: those of a harness process, by their roles. A part is started, watched and ended
            with its process.
        inbox: what it has said and nobody has taken yet.
        exit_expected: whether its end is no failure, because it was told to, or is meant to.
        has_replied: whether it has ever said anything.
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
        self.parts: dict[str, ManagedProcess] = {}
        self._redact = redact
        self._pending = bytearray()

    @property
    def pid(self) -> int:
        """The process id, which is also the id of its session and process group."""
        return self.process.pid

    @property
    def is_running(self) -> bool:
        """Whether it has not ended yet."""
        return self.process.poll() is None

    @property
    def session(self) -> Session:
        """The session that it opened."""
        return self.process.session

    def send(self, message: Any) -> None:
        """Send a command; a child that does not take it is dead or hangs, which will be noticed."""
        if self.connection is not None:
            with contextlib.suppress(OSError):
                self.connection.settimeout(_SEND_TIMEOUT_S)
                self.connection.sendall(protocol.encode(message))

    def read(self) -> bool:
        """Put what has arrived into the inbox; False at the end of the channel."""
        if self.connection is None:
            return False
        try:
            # The end may never come: a child that has died can have forked one that holds it.
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
            # Whatever else a node may write to this socket by mistake is not for the controller.
            with contextlib.suppress(msgspec.DecodeError):
                self.inbox.append(protocol.decode_reply(bytes(line)))
                self.has_replied = True
        return bool(received)

    def request_shutdown(self) -> None:
        """Ask it, in the way that it understands, to end by itself."""
        self.exit_expected = True
        self.send(protocol.Shutdown())
        if self.connection is None:
            self.signal(signal.SIGINT)
        elif not self.has_replied:
            # It is still being made, or hangs in that: it hears nothing, and has nothing yet
            # that it must put in order.
            self.signal(signal.SIGTERM)

    def signal(self, which: signal.Signals) -> None:
        """Send a signal to its whole process group, unless it has ended and been collected."""
        if not self.is_running:
            # Its number may be that of another group by now.
            return
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, which)

    def log_tail(self) -> str:
        """The last lines that the process printed, without the secrets that it was given."""
        try:
            with self.log.open("rb") as file:
                file.seek(0, 2)
                file.seek(max(0, file.tell() - _LOG_TAIL_BYTES))
                text = file.read().decode(errors="replace")
        except OSError:
            return ""
        return self._redact("\n".join(text.splitlines()[-_LOG_TAIL_LINES:]))


def describe_exit(status: int) -> str:
    """Put a return code of `subprocess` in words."""
    if status >= 0:
        return f"ended with status {status}"
    with contextlib.suppress(ValueError):
        return f"was killed by {signal.Signals(-status).name}"
    return f"was killed by signal {-status}"
