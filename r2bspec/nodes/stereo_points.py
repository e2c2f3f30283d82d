"""Points in space from disparities.

Pixel (u, v) with disparity d lies at depth Z = f T / d, with the focal length f in pixels and the
baseline T in metres, and at X = (u - cx) Z / fx, Y = (v - cy) Z / fy of the rectified left camera.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from r2bspec.nodes.images import Pixels

POINT_TYPE = np.dtype(
    {
        "names": ["x", "y", "z", "rgb"],
        "formats": [np.float32, np.float32, np.float32, np.uint32],
        "offsets": [0, 4, 8, 12],
        "itemsize": 16,
    }
)
"""The layout of stereo_image_proc: colours are 0x00RRGGBB in the bits of a float32."""

# Where red, green and blue are in a pixel.
_CHANNELS = MappingProxyType(
    {"rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0)}
)


def points(
    disparity: NDArray[np.float32],
    projection: NDArray[np.float64],
    focal_px: float,
    baseline_m: float,
    min_disparity_px: float = 0.0,
) -> NDArray[np.void]:
    """The point of each pixel in the left camera's rectified frame, metres.

    Args:
        disparity: pixels, shape (height, width).
        projection: of the left camera, shape (3, 4).
        focal_px: of the disparities.
        baseline_m: distance of the cameras.
        min_disparity_px: what is smaller is no disparity.

    Returns:
        `POINT_TYPE`, shape (height, width), black; NaN where there is no disparity, or it is not
        above 0 and the point not before the camera.
    """
    height, width = disparity.shape
    known = (disparity >= min_disparity_px) & (disparity > 0)
    depth = np.full(disparity.shape, np.nan, np.float32)
    np.divide(np.float32(focal_px * baseline_m), disparity, out=depth, where=known)
    across = (np.arange(width) - projection[0, 2]) / projection[0, 0]
    down = (np.arange(height) - projection[1, 2]) / projection[1, 1]
    cloud = np.zeros(disparity.shape, POINT_TYPE)
    cloud["x"] = depth * across.astype(np.float32)[None, :]
    cloud["y"] = depth * down.astype(np.float32)[:, None]
    cloud["z"] = depth
    return cloud


def colors(pixels: Pixels, encoding: str) -> NDArray[np.uint32]:
    """The colour of each pixel as 0x00RRGGBB.

    Raises:
        ValueError: the encoding is not an 8-bit colour or gray one.
    """
    if encoding == "mono8":
        return pixels.astype(np.uint32) * np.uint32(0x010101)
    if encoding not in _CHANNELS:
        raise ValueError(f"image encoding {encoding!r} is not one of mono8, {', '.join(_CHANNELS)}")
    red, green, blue = (pixels[:, :, each].astype(np.uint32) for each in _CHANNELS[encoding])
    packed: Any = (red << np.uint32(16)) | (green << np.uint32(8)) | blue
    return np.asarray(packed, np.uint32)
