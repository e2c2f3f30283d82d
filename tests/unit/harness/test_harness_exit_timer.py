"""Promise: a process of the harness ends, whatever the middleware does while it is left."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

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


@pytest.mark.parametrize("status", [0, 1])
def test_a_hanging_destructor_does_not_keep_a_process_alive(status: int) -> None:
    assert leave(HOLDS_THE_INTERPRETER, 0.1, status) == status


def test_without_it_the_process_would_hang() -> None:
    program = PROGRAM.replace("start_exit_timer(float", "(lambda *_: None)(float")
    process = subprocess.Popen(
        [sys.executable, "-c", program.format(then=HOLDS_THE_INTERPRETER), "0.1", "0"]
    )
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(1.0)
    process.kill()
    assert process.wait() == -signal.SIGKILL


def test_a_process_that_leaves_in_time_ends_with_its_own_status() -> None:
    assert leave("sys.exit(5)", 30.0, 0) == 5
