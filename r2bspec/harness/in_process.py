"""Parts of the harness in one process, each on a thread of its own, and nodes beside them.

In one process the middleware hands a message from writer to reader itself: no shared memory, no
thread to be woken. That halves what a message costs, and is the placement of ros2_benchmark.
The price is one interpreter for all: while Python code of one thread runs, the others wait. Player
and monitor are rarely in its way, because they publish, take and wait without the interpreter's
lock; Python nodes beside them can make the player late, and a run says by how much.
"""

from __future__ import annotations

import sys
import threading

from r2bspec.harness.control_channel import Channel
from r2bspec.harness.node_host import NodeHost
from r2bspec.harness.roles import play_role
from r2bspec.ipc import protocol

_SWITCH_INTERVAL_S = 0.0002
"""How long a thread may keep the interpreter from others that wait for it. The usual 5 ms would
make the player that late whenever a node computes."""

_JOIN_TIMEOUT_S = 2.0
"""How long a part may take to end; one that is blocked ends with the process."""


class InProcessHarness:
    """Player and monitor as threads of one process, and the Python nodes beside them."""

    def __init__(self, channel: Channel, settings: protocol.ConfigureHarness) -> None:
        self._channel = channel
        self._channels = {part: Channel.from_environment(part) for part in settings.parts}
        self._parts = [
            threading.Thread(target=play_role, args=[own], name=part, daemon=True)
            for part, own in self._channels.items()
        ]

    def serve(self) -> None:
        """Let the parts play, host nodes if there are any, and end when told to shut down.

        What a part cannot do it says on its own channel.
        """
        sys.setswitchinterval(_SWITCH_INTERVAL_S)
        for part in self._parts:
            part.start()
        try:
            self._channel.send(protocol.Ready())
            match self._channel.receive():
                case protocol.ConfigureHost() as nodes:
                    NodeHost(self._channel, nodes).serve()
                case _:
                    return
        finally:
            self._end_parts()

    def _end_parts(self) -> None:
        """End the parts: without a channel they have nothing more to do."""
        for own in self._channels.values():
            own.close()
        for part in self._parts:
            part.join(_JOIN_TIMEOUT_S)
