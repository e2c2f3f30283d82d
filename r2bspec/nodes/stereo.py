"""Disparities of rectified stereo images, by OpenCV's block matcher; points in space from them.

Pixel (u, v) with disparity d lies at depth Z = f T / d, with the focal length f in pixels and the
baseline T in metres, and at X = (u - cx) Z / fx, Y = (v - cy) Z / fy of the rectified left camera.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from r2bspec.nodes.images import Pixels, cv2

# The matcher returns whole sixteenths of a pixel.
DISPARITY_STEP_PX = 1.0 / 16.0


@dataclass(frozen=True, slots=True)
class ValidWindow:
    """The rectangle in which disparities can be found, pixels."""

    x: int
    y: int
    width: int
    height: int


def make_matcher(range_px: int, window_px: int) -> Any:
    """Return OpenCV's block matcher, with the defaults of stereo_image_proc.

    Args:
        range_px: how many disparities are tried, from 0 on; a multiple of 16.
        window_px: edge of the square that is compared, odd.
    """
    matcher = cv2.StereoBM.create(range_px, window_px)
    matcher.setPreFilterCap(31)
    matcher.setTextureThreshold(10)
    matcher.setUniquenessRatio(15)
    matcher.setSpeckleWindowSize(100)
    matcher.setSpeckleRange(4)
    return matcher


def disparity(
    matcher: Any, left: NDArray[np.uint8], right: NDArray[np.uint8], offset_px: float = 0.0
) -> NDArray[np.float32]:
    """Return the disparity of each pixel of the left image.

    Args:
        matcher: the result of `make_matcher`.
        left: gray, shape (height, width).
        right: the same.
        offset_px: the left principal point minus the right one, in columns: a point at infinity
            has this disparity in the images, and 0 in the result.

    Returns:
        Pixels, shape (height, width). Where none was found, -1 minus the offset.

    Raises:
        ValueError: the images differ in size.
    """
    if left.shape != right.shape:
        raise ValueError(
            f"the left image has {left.shape[1]}x{left.shape[0]} pixels, "
            f"the right one {right.shape[1]}x{right.shape[0]}"
        )
    steps = matcher.compute(left, right)
    disparities: NDArray[np.float32] = steps.astype(np.float32) * np.float32(DISPARITY_STEP_PX)
    disparities -= np.float32(offset_px)
    return disparities


def valid_window(range_px: int, window_px: int, width: int, height: int) -> ValidWindow:
    """Return where a whole window and the whole range of disparities lie inside both images."""
    half = window_px // 2
    left = range_px - 1 + half
    return ValidWindow(
        x=min(left, width),
        y=min(half, height),
        width=max(0, width - half - left),
        height=max(0, height - 2 * half),
    )


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
    """Return the point of each pixel in the left camera's rectified frame, metres.

    Args:
        disparity: pixels, shape (height, width).
        projection: the projection of the left camera, shape (3, 4).
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
    """Return the colour of each pixel as 0x00RRGGBB.

    Raises:
        ValueError: the encoding is not an 8-bit colour or gray one.
    """
    if encoding == "mono8":
        return pixels.astype(np.uint32) * np.uint32(0x010101)
    if encoding not in _CHANNELS:
        raise ValueError(f"image encoding {encoding!r} is not one of mono8, {', '.join(_CHANNELS)}")
    red, green, blue = (pixels[:, :, channel].astype(np.uint32) for channel in _CHANNELS[encoding])
    packed: Any = (red << np.uint32(16)) | (green << np.uint32(8)) | blue
    return np.asarray(packed, np.uint32)
