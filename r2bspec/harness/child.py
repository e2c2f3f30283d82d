"""The main program of every harness process: ``python -m r2bspec.harness.child``.

The first command sets the role. A process exits with the status OK on the command to shut down or
when the controller has exited, and with FINDINGS_OR_FAILED after it has reported an error.
"""

from __future__ import annotations

import os
import signal
import sys

from r2bspec.exit_status import ExitStatus
from r2bspec.harness.control_channel import Channel
from r2bspec.harness.exit_timer import start_exit_timer
from r2bspec.harness.roles import play_role
from r2bspec.middleware.middleware import middleware_of

_MAX_EXIT_S = 8.0
"""How long the shutdown of ROS may take, including `destroy_node` of the nodes. Less than the
controller waits before it sends SIGTERM."""


def main() -> int:
    """Play the role that the controller assigns; returns the exit status."""
    # Ctrl-C goes to the controller, which ends its children in order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        channel = Channel.from_environment()
    except KeyError:
        sys.stderr.write("this program is started by 'r2bspec run' and cannot be run alone\n")
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
