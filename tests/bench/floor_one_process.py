"""Player and monitor as two threads of one process; started by `floor_harness`.

The player has the control channel; the monitor is told by this program what to watch.
"""

from __future__ import annotations

import os
import socket
import sys
import threading
from typing import Any, cast

from floor_child import leave_out

from r2bspec.harness import protocol, ros
from r2bspec.harness.channel import Channel
from r2bspec.harness.monitor import Monitor
from r2bspec.harness.player import Player


def main() -> None:
    leave_out()
    channel = Channel.from_environment()
    player = Player(channel, cast("Any", channel.receive()))
    settings = protocol.decode_command(sys.argv[1].encode())
    ours, theirs = socket.socketpair()
    monitor = Monitor(Channel(theirs), cast("Any", settings))
    threading.Thread(target=monitor.serve, daemon=True).start()
    ours.sendall(protocol.encode(protocol.Subscribe()))
    player.serve()
    ros.finish()
    os._exit(0)


if __name__ == "__main__":
    main()
