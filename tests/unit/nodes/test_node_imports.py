"""Importing the nodes' package costs nothing; what a node lacks is said in words."""

from __future__ import annotations

import subprocess
import sys

from r2bspec.extras import install_command


def test_a_missing_opencv_is_named_with_its_remedy() -> None:
    code = "import sys; sys.modules['cv2'] = None; import r2bspec.nodes.tag_poses"
    refused = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    ).stderr
    assert "ImportError: this node needs OpenCV" in refused
    assert install_command("vision") in refused
