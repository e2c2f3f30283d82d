"""Undistorting and rectifying images, as their camera_info says.

A rectified image has no distortion, and the camera matrix of `p`; in a stereo pair, the rows of
both images then correspond. The distortion and the rotation `r` are those of the camera model of
OpenCV and image_geometry.
"""

from __future__ import annotations

from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from r2bspec.nodes import camera
from r2bspec.nodes.images import Pixels, cv2

if TYPE_CHECKING:
    from sensor_msgs.msg import CameraInfo

INTERPOLATIONS = MappingProxyType(
    {0: cv2.INTER_NEAREST, 1: cv2.INTER_LINEAR, 2: cv2.INTER_CUBIC, 4: cv2.INTER_LANCZOS4}
)
"""In image_proc's numbers: 0 nearest, 1 linear, 2 cubic, 4 Lanczos over 8x8 pixels."""

# Cameras of a stereo rig with a colour camera, and some to spare.
_CACHED_CAMERAS = 8


def rectify(pixels: Pixels, info: CameraInfo, target: Pixels, interpolation: int = 1) -> None:
    """Write the rectified image into `target`, whose shape and type are those of `pixels`.

    Pixels that the camera did not see are 0.

    Raises:
        ValueError: the camera is not calibrated, or its distortion model is unknown.
    """
    height, width = pixels.shape[:2]
    # Arrays have no hash, by which the maps of a camera are found again.
    matrix, distortion, rotation, projection = (
        tuple(part(info).ravel().tolist())
        for part in (camera.matrix, camera.distortion, camera.rotation, camera.projection)
    )
    first, second = _maps(matrix, distortion, rotation, projection, (width, height))
    cv2.remap(
        pixels,
        first,
        second,
        INTERPOLATIONS[interpolation],
        dst=target,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=0,
    )


@lru_cache(maxsize=_CACHED_CAMERAS)
def _maps(
    matrix: tuple[float, ...],
    distortion: tuple[float, ...],
    rotation: tuple[float, ...],
    projection: tuple[float, ...],
    size: tuple[int, int],
) -> tuple[Any, Any]:
    """For each pixel of the rectified image, where it is in the image of the camera.

    In fixed point (CV_16SC2), which is twice as fast to read as floats and exact to 1/32 pixel.
    """
    maps: tuple[Any, Any] = cv2.initUndistortRectifyMap(
        np.array(matrix).reshape(3, 3),
        np.array(distortion),
        np.array(rotation).reshape(3, 3),
        np.array(projection).reshape(3, 4)[:, :3],
        size,
        cv2.CV_16SC2,
    )
    return maps
