"""Nodes end without a word."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("cv2")

_SCRIPT = """
import rclpy, r2bspec.nodes
rclpy.init(domain_id=101)
nodes = [getattr(r2bspec.nodes, name)() for name in r2bspec.nodes.__all__]
if {destroy}:
    for node in nodes:
        node.destroy_node()
rclpy.shutdown()
"""


@pytest.mark.parametrize("destroy", [True, False])
def test_a_process_of_all_nodes_ends_silently(destroy: bool) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", _SCRIPT.format(destroy=destroy)],
        env=os.environ | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
