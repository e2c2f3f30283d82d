"""The camera of tests and its images, as messages of sensor_msgs have them."""

from __future__ import annotations

from array import array
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray


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


def message(pixels: NDArray[Any], encoding: str, padding: int = 0) -> SimpleNamespace:
    """The image that a driver would send for pixels, each row followed by padding bytes."""
    height, width = pixels.shape[:2]
    rows = pixels.reshape(height, -1).view(np.uint8)
    padded = np.pad(rows, ((0, 0), (0, padding)), constant_values=0xEE)
    return SimpleNamespace(
        height=height,
        width=width,
        encoding=encoding,
        step=padded.shape[1],
        data=array("B", padded.tobytes()),
        is_bigendian=int(pixels.dtype.byteorder == ">"),
    )
