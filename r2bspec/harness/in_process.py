"""Player and monitor in one process, each on its own thread, and optionally nodes.

Within one process the middleware passes a message from publisher to subscription directly: without
shared memory, and without waking a thread. This halves the cost of a message, and is the placement
of ros2_benchmark. The disadvantage is a shared interpreter: while the Python code of one thread
runs, the others wait. Player and monitor rarely block it, because they publish, take and wait
without the interpreter lock. Python nodes in this process can delay the player; the run reports
its lateness.
"""

from __future__ import annotations

import sys
import threading

from r2bspec.harness.control_channel import Channel
from r2bspec.harness.node_host import NodeHost
from r2bspec.harness.roles import play_role
from r2bspec.ipc import protocol

_SWITCH_INTERVAL_S = 0.0002
"""How long a thread may hold the interpreter lock while others wait. The default of 5 ms would
delay the player by as much whenever a node computes."""

_JOIN_TIMEOUT_S = 2.0
"""How long a part may take to end; a blocked one ends with the process."""


class InProcessHarness:
    """Player and monitor as threads of one process, and the Python nodes in this process."""

    def __init__(self, channel: Channel, settings: protocol.ConfigureHarness) -> None:
        self._channel = channel
        self._channels = {part: Channel.from_environment(part) for part in settings.parts}
        self._parts = [
            threading.Thread(target=play_role, args=[own], name=part, daemon=True)
            for part, own in self._channels.items()
        ]

    def serve(self) -> None:
        """Run the parts and the nodes, if there are any, until told to shut down.

        A part reports errors on its own channel.
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
        """End the parts by closing their channels."""
        for own in self._channels.values():
            own.close()
        for part in self._parts:
            part.join(_JOIN_TIMEOUT_S)
