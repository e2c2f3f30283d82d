"""The camera of tests, as sensor_msgs/msg/CameraInfo has it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np


def camera_info(**fields: Any) -> SimpleNamespace:
    """A camera without distortion and rotation, with some fields replaced."""
    defaults = {
        "width": 1280,
        "height": 800,
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": [640.0, 0.0, 652.5, 0.0, 645.0, 401.0, 0.0, 0.0, 1.0],
        "r": np.eye(3).ravel(),
        "p": [630.0, 0.0, 650.0, -59.85, 0.0, 630.0, 400.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        "binning_x": 0,
        "binning_y": 0,
        "roi": SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0),
    }
    return SimpleNamespace(**(defaults | fields))
