"""The main program of every harness process: ``python -m r2bspec.harness.child``.

The first command says which role to play. A process ends with the status OK when it is told to
shut down or when the controller is gone, and with FINDINGS_OR_FAILED after it has reported its
error.
"""

from __future__ import annotations

import os
import signal
import sys

from r2bspec.exit_status import ExitStatus
from r2bspec.harness.control_channel import Channel
from r2bspec.harness.exit_timer import start_exit_timer
from r2bspec.harness.roles import play_role
from r2bspec.middleware.rmw_registry import middleware_of

_MAX_EXIT_S = 8.0
"""How long leaving ROS may take, which may include what a node does when it is destroyed. Less
than the controller waits before it sends SIGTERM."""


def main() -> int:
    """Play the role that the controller assigns; returns the exit status."""
    # Ctrl-C goes to the controller, which ends its children in order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        channel = Channel.from_environment()
    except KeyError:
        sys.stderr.write("this program is started by r2bspec run, not by hand\n")
        return ExitStatus.USAGE
    return play_role(channel)


if __name__ == "__main__":
    status = main()
    if "rclpy" in sys.modules:
        from r2bspec.harness import rclpy_tools

        if middleware_of(os.environ).may_hang_on_exit:
            start_exit_timer(_MAX_EXIT_S, status)
        rclpy_tools.finish()
    sys.stdout.flush()
    sys.stderr.flush()
    # Threads of the middleware may still run; destructors at interpreter exit can then hang or
    # crash after all work is done.
    os._exit(status)
