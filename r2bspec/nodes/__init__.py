"""Reference nodes: rclpy nodes that a spec can use, and that do not depend on r2bspec.

The classes are loaded on first access, so that importing this package needs neither rclpy nor
OpenCV. The topics and parameters of each node are in ``interfaces.yaml`` in this folder, for tools
that must not run them.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from r2bspec.nodes.apriltag import AprilTagNode
    from r2bspec.nodes.disparity import DisparityNode
    from r2bspec.nodes.point_cloud import PointCloudNode
    from r2bspec.nodes.rectify import RectifyNode
    from r2bspec.nodes.relay import RelayNode
    from r2bspec.nodes.resize import ResizeNode

__all__ = [
    "AprilTagNode",
    "DisparityNode",
    "PointCloudNode",
    "RectifyNode",
    "RelayNode",
    "ResizeNode",
]

_MODULES = {
    "AprilTagNode": "apriltag",
    "DisparityNode": "disparity",
    "PointCloudNode": "point_cloud",
    "RectifyNode": "rectify",
    "RelayNode": "relay",
    "ResizeNode": "resize",
}


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
