"""Importing the nodes' package costs nothing; what a node lacks is said in words."""

from __future__ import annotations

import subprocess
import sys

import pytest

import r2bspec.nodes
from r2bspec.extras import install_command


def test_a_missing_opencv_is_named_with_its_remedy() -> None:
    code = "import sys; sys.modules['cv2'] = None; import r2bspec.nodes.tag_poses"
    refused = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    ).stderr
    assert "ImportError: this node needs OpenCV" in refused
    assert install_command("vision") in refused


def test_an_unknown_node_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'RezizeNode'"):
        getattr(r2bspec.nodes, "RezizeNode")  # noqa: B009


def test_the_nodes_are_listed() -> None:
    assert {"AprilTagNode", "RelayNode", "ResizeNode"} <= set(dir(r2bspec.nodes))
