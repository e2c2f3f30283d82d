"""A workspace with nodes as people write them: `bench` with specs beside `src` with a package."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import yaml

_FILES: Final[dict[str, str]] = yaml.safe_load(
    Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8")
)

TARGETS: Final = {
    "detector": ("./detector.py:main", {"image"}, {"detections"}),
    "detector_class": ("./detector.py:Detector", {"image"}, {"detections"}),
    "stereo_sync": ("./stereo_sync.py:main", {"left", "right"}, {"disparity"}),
    "lidar_filter": ("./lidar_filter.py:LidarFilter", {"scan"}, {"filtered"}),
    "odometry": ("./odometry.py:main", {"imu"}, {"odom"}),
    "grasp_server": ("./grasp_server.py:GraspServer", {"camera"}, {"grasp_view"}),
    "threshold": ("./threshold.py:Threshold", {"frame"}, {"mask"}),
    "projector": ("./projector.py:Projector", {"/tf", "/tf_static", "depth"}, {"projected"}),
    "driver": ("drive_pkg:driver", {"goal"}, {"cmd"}),
}
"""What ``init --node`` gets for each style, and what the node subscribes to and publishes."""


def write_workspace(top: Path) -> Path:
    """Write the workspace; returns the folder for specs."""
    for name, text in _FILES.items():
        file = top / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    return top / "bench"
