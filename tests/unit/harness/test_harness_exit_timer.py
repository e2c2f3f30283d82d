"""Promise: a process of the harness ends, whatever the middleware does while it is left."""

from __future__ import annotations

import subprocess
import sys

HANG_S = 60.0

PROGRAM = """
import ctypes, sys, time
from r2bspec.harness.child import start_exit_timer
start_exit_timer(float(sys.argv[1]), int(sys.argv[2]))
{then}
"""

HOLDS_THE_INTERPRETER = "ctypes.PyDLL(None).pause()"
"""Waits for ever in native code, and lets no thread of Python run meanwhile."""


def leave(then: str, seconds: float, status: int) -> int:
    program = PROGRAM.format(then=then)
    command = [sys.executable, "-c", program, str(seconds), str(status)]
    return subprocess.run(command, timeout=HANG_S, check=False).returncode


def test_a_hanging_destructor_does_not_keep_a_process_alive() -> None:
    assert leave(HOLDS_THE_INTERPRETER, 0.1, 7) == 7


def test_a_process_that_leaves_in_time_ends_with_its_own_status() -> None:
    assert leave("sys.exit(5)", 30.0, 0) == 5
