"""Player and monitor in the process of Python nodes.

Within one process the middleware passes a message from publisher to subscription directly: without
shared memory, and without waking a thread. Player and monitor are native threads, which neither
hold nor wait for the lock of the interpreter; only the nodes use it.
"""

from __future__ import annotations

import ctypes
import os
import sys

from r2bspec.harness.control_channel import Channel
from r2bspec.harness.node_host import NodeHost
from r2bspec.ipc import protocol

_SWITCH_INTERVAL_S = 0.0002
"""How long a thread may hold the interpreter lock while others wait. The default of 5 ms would
delay the nodes by as much whenever one of them computes."""


class InProcessHarness:
    """Player and monitor as threads of this process, and its Python nodes."""

    def __init__(self, channel: Channel, settings: protocol.ConfigureHarness) -> None:
        self._channel = channel
        self._library = ctypes.CDLL(os.environ.pop(protocol.NATIVE_LIBRARY_VARIABLE))
        for part in settings.parts:
            number = int(os.environ.pop(protocol.control_variable(part)))
            if status := self._library.r2bspec_harness_serve(number):
                raise OSError(-status, os.strerror(-status), part)

    def serve(self) -> None:
        """Run the nodes until told to shut down; a part reports errors on its own channel."""
        sys.setswitchinterval(_SWITCH_INTERVAL_S)
        try:
            self._channel.send(protocol.Ready())
            match self._channel.receive():
                case protocol.ConfigureHost() as nodes:
                    NodeHost(self._channel, nodes).serve()
                case _:
                    return
        finally:
            self._library.r2bspec_harness_join()
