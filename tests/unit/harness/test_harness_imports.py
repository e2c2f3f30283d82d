"""What the controller shares with its children needs no ROS and starts fast."""

from __future__ import annotations

import subprocess
import sys

SHARED = (
    *("harness.control_channel", "harness.watchdog", "ipc.buffers", "ipc.process_cleanup"),
    *("ipc.protocol", "ipc.sample_files", "record.files"),
)


def test_shared_modules_import_neither_ros_nor_numpy() -> None:
    program = (
        f"import sys; import {', '.join(f'r2bspec.{module}' for module in SHARED)}; "
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
