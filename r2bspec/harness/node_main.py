"""Runs a function that is a program: ``-m r2bspec.harness.node_main TARGET [ARGUMENT]...``.

It is called without arguments, as the entry point of ``ros2 run`` calls it: its call of
``rclpy.init`` reads the ROS arguments from the command line. Its file is not run as a script,
because ``if __name__ == "__main__"`` may do something else.
"""

from __future__ import annotations

import sys
from pathlib import Path

from r2bspec.exit_status import ExitStatus
from r2bspec.harness.node_factory import NodeError, find_factory


def main() -> None:
    """Call the function that the command line names, and exit with what it returns."""
    target, *arguments = sys.argv[1:]
    try:
        function = find_factory(target, Path.cwd())
    except NodeError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(ExitStatus.FINDINGS_OR_FAILED)
    sys.argv = [target.rpartition(":")[0] or target, *arguments]
    sys.exit(function())


if __name__ == "__main__":
    main()
