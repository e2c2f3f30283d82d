"""Runs a function that is a program: ``-m r2bspec.harness.node_main TARGET [ARGUMENT]...``.

It is called without arguments, as the entry point of ``ros2 run`` calls it: its call of
``rclpy.init`` reads the ROS arguments from the command line. Its file is not run as a script,
because ``if __name__ == "__main__"`` may do something else.

When it exits, the process names the files of the modules that it has imported, in a file of the
folder that a variable names: the kernel does not know them.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import sys
from pathlib import Path

from r2bspec.exit_status import ExitStatus
from r2bspec.harness.node_factory import NodeError, find_factory, module_files
from r2bspec.ipc.protocol import MODULES_FOLDER_VARIABLE


def main() -> None:
    """Call the function that the command line names, and exit with what it returns."""
    target, *arguments = sys.argv[1:]
    if folder := os.environ.get(MODULES_FOLDER_VARIABLE):
        atexit.register(_name_modules, Path(folder))
    try:
        function = find_factory(target, Path.cwd())
    except NodeError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(ExitStatus.FINDINGS_OR_FAILED)
    sys.argv = [target.rpartition(":")[0] or target, *arguments]
    sys.exit(function())


def _name_modules(folder: Path) -> None:
    with contextlib.suppress(OSError):
        folder.mkdir(exist_ok=True)
        (folder / f"{os.getpid()}.json").write_text(json.dumps(module_files()))


if __name__ == "__main__":
    main()
