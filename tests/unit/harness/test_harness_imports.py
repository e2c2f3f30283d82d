"""What the controller shares with its children needs no ROS and starts fast."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    "module",
    [
        "harness.control_channel",
        "harness.watchdog",
        "ipc.buffers",
        "ipc.stamps",
        "ipc.process_cleanup",
        "ipc.protocol",
        "ipc.sample_files",
    ],
)
def test_shared_modules_import_neither_ros_nor_numpy(module: str) -> None:
    program = (
        f"import sys, r2bspec.{module}; "
        "print([name for name in ('rclpy', 'numpy', 'scipy') if name in sys.modules])"
    )
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    assert said.stdout.strip() == b"[]"


def test_a_harness_program_that_is_started_by_hand_says_so() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "r2bspec.harness.child"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr == "this program is started by 'r2bspec run' and cannot be run alone\n"
