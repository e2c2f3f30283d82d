"""A slow and unreliable connection: a TCP proxy on this machine in front of a server."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from typing import Any

_CHUNK_BYTES = 64 << 10


class SlowLink:
    """Passes connections on to a server; what the server sends is slowed down and counted.

    Attributes:
        passed: bytes that the server has sent to its clients.
        cuts: how often all connections were cut.
        spoilt: how many chunks were changed on their way.
    """

    def __init__(
        self, server_port: int, *, bytes_per_s: float, cut_at: int = 0, spoil: bytes = b""
    ) -> None:
        """Listen.

        Args:
            server_port: of the server on this machine.
            bytes_per_s: that all connections together receive from the server.
            cut_at: all connections are cut once, when so many bytes have passed; never if 0.
            spoil: the first chunk that contains these bytes has one of them changed.
        """
        self._server_port = server_port
        self._bytes_per_s = bytes_per_s
        self._cut_at = cut_at
        self._spoil = spoil
        self._lock = threading.Lock()
        self._open: set[socket.socket] = set()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._plugged = threading.Event()
        self._plugged.set()
        self.passed = 0
        self.cuts = 0
        self.spoilt = 0
        threading.Thread(target=self._accept, daemon=True).start()

    def __enter__(self) -> SlowLink:
        return self

    def __exit__(self, *_: object) -> None:
        self._plugged.set()
        # Closing alone would not wake the thread that accepts.
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._cut()

    @property
    def address(self) -> str:
        """Where clients connect instead of to the server."""
        host, port = self._listener.getsockname()
        return f"tcp://{host}:{port}"

    def unplug(self) -> None:
        """Lose everything from now on, also that a connection was closed."""
        self._plugged.clear()

    def plug_in(self) -> None:
        """Pass on again; what was open before is unknown to the other side, and reset."""
        self._plugged.set()
        self._cut()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            try:
                server = socket.create_connection(("127.0.0.1", self._server_port))
            except OSError:
                client.close()
                continue
            with self._lock:
                self._open |= {client, server}
            for source, target, is_slow in ((client, server, False), (server, client, True)):
                words: tuple[Any, ...] = (source, target, is_slow)
                threading.Thread(target=self._pass_on, args=words, daemon=True).start()

    def _pass_on(self, source: socket.socket, target: socket.socket, is_slow: bool) -> None:
        with contextlib.suppress(OSError):
            while chunk := source.recv(_CHUNK_BYTES):
                if self._plugged.is_set():
                    target.sendall(self._slowed(chunk) if is_slow else chunk)
        self._plugged.wait()
        for each in (source, target):
            self._close(each)

    def _slowed(self, chunk: bytes) -> bytes:
        with self._lock:
            time.sleep(len(chunk) / self._bytes_per_s)
            self.passed += len(chunk)
            must_cut = 0 < self._cut_at <= self.passed and self.cuts == 0
            self.cuts += must_cut
            if self._spoil and self._spoil in chunk and self.spoilt == 0:
                self.spoilt += 1
                chunk = chunk.replace(self._spoil, b"\0" + self._spoil[1:], 1)
        if must_cut:
            self._cut()
        return chunk

    def _cut(self) -> None:
        with self._lock:
            found, self._open = self._open, set()
        for each in found:
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)

    def _close(self, found: socket.socket) -> None:
        with self._lock:
            self._open.discard(found)
        with contextlib.suppress(OSError):
            found.shutdown(socket.SHUT_RDWR)
        found.close()
