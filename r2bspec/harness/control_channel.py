"""The child's end of the control channel: a local socket with one message per line.

The channel is a plain socket and not ROS, so that it is not part of the graph under test and does
not depend on discovery. It closes when the controller exits for any reason.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
from typing import Any

from r2bspec.ipc import protocol


class ChannelClosedError(Exception):
    """The controller has exited."""


class Channel:
    """Reads commands and writes replies; used by one thread at a time for each direction."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._pending = bytearray()

    @classmethod
    def from_environment(cls, part: str = "") -> Channel:
        """Open the inherited socket of this process, or of a part of it.

        Raises:
            KeyError: this process was not started by a controller, or has no such part.
        """
        number = int(os.environ.pop(protocol.control_variable(part)))
        os.set_inheritable(number, False)
        return cls(socket.socket(fileno=number))

    def close(self) -> None:
        """Close the channel, also for a thread that waits on it."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    def send(self, message: Any) -> None:
        """Send a reply.

        Raises:
            ChannelClosedError: the controller has exited.
        """
        try:
            self._socket.sendall(protocol.encode(message))
        except OSError as error:
            raise ChannelClosedError from error

    def receive(self) -> protocol.Command:
        """Wait for the next command.

        Raises:
            ChannelClosedError: the controller has exited.
        """
        while True:
            line, separator, rest = self._pending.partition(b"\n")
            if separator:
                self._pending = rest
                return protocol.decode_command(bytes(line))
            try:
                received = self._socket.recv(1 << 16)
            except OSError as error:
                raise ChannelClosedError from error
            if not received:
                raise ChannelClosedError
            self._pending += received

    def wait_for_shutdown(self) -> None:
        """Ignore all commands until told to shut down.

        Raises:
            ChannelClosedError: the controller has exited.
        """
        while not isinstance(self.receive(), protocol.Shutdown):
            pass

    def wait(self, timeout_s: float | None) -> bool:
        """Sleep for at most `timeout_s` seconds; True as soon as a command can be received.

        None is no limit.
        """
        if b"\n" in self._pending:
            return True
        readable, _, _ = select.select(
            [self._socket], [], [], None if timeout_s is None else max(timeout_s, 0.0)
        )
        return bool(readable)
