"""The main program of every harness process: ``python -m r2bspec.harness.child``.

The first command says which role to play. A process ends with status 0 when it is told to shut
down or when the controller is gone, and with status 1 after it has said why it failed.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import traceback
from typing import Protocol

from r2bspec.harness import protocol
from r2bspec.harness.channel import Channel, ChannelClosedError
from r2bspec.harness.leaving import leave_within

_LEAVE_S = 8.0
"""How long leaving ROS may take, which may include what a node does when it is destroyed. Less
than the controller waits before it sends SIGTERM."""


class _Role(Protocol):
    def serve(self) -> None: ...


def main() -> int:
    """Play the role that the controller assigns; returns the exit status."""
    # Ctrl-C goes to the controller, which ends its children in order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        channel = Channel.from_environment()
    except KeyError:
        sys.stderr.write("this program is started by r2bspec run, not by hand\n")
        return 2
    try:
        _take_role(channel, channel.receive()).serve()
    except ChannelClosedError:
        return 0
    except Exception as error:
        sys.stderr.write(traceback.format_exc())
        with contextlib.suppress(ChannelClosedError):
            channel.send(_failure(error))
        return 1
    return 0


def _take_role(channel: Channel, command: protocol.Command) -> _Role:
    """Make the role; each is imported only by the process that plays it."""
    match command:
        case protocol.ConfigureLoader():
            from r2bspec.harness.loader import Loader

            return Loader(channel, command)
        case protocol.ConfigurePlayer():
            from r2bspec.harness.player import Player

            return Player(channel, command)
        case protocol.ConfigureMonitor():
            from r2bspec.harness.monitor import Monitor

            return Monitor(channel, command)
        case protocol.ConfigureHost():
            from r2bspec.harness.host import Host

            return Host(channel, command)
        case protocol.ConfigureCaller():
            from r2bspec.harness.caller import Caller

            return Caller(channel, command)
    raise RuntimeError(f"a process is configured first, not told to {type(command).__name__}")


def _failure(error: Exception) -> protocol.Failed:
    code = getattr(error, "code", "R2B630")
    hint = getattr(error, "hint", "")
    message = str(error) or type(error).__name__
    if isinstance(error, ImportError):
        code, hint = "R2B620", "install ROS 2, or pip install 'r2bspec[ros]'"
    return protocol.Failed(code=code, message=message, hint=hint)


if __name__ == "__main__":
    status = main()
    if "rclpy" in sys.modules:
        from r2bspec.harness import ros

        leave_within(_LEAVE_S, status)
        ros.finish()
    sys.stdout.flush()
    sys.stderr.flush()
    # Threads of the middleware may still run; destructors at interpreter exit can then hang or
    # crash after all work is done.
    os._exit(status)
