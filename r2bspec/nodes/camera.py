"""Pinhole geometry of sensor_msgs/msg/CameraInfo, and rectified images by it.

A pixel's integer coordinate is its centre, as OpenCV has it, so the left edge of an image lies at u
= -0.5. If an image is resized by s, a point at u therefore moves to (u + 0.5) s - 0.5, and the
principal point with it; scaling it by s alone would move every ray by (1 - s) / 2 pixels.

A rectified image has no distortion, and the camera matrix of `p`; in a stereo pair, the rows of
both images then correspond. The distortion and the rotation `r` are those of the camera model of
OpenCV and image_geometry.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from r2bspec.nodes.images import Pixels, cv2

if TYPE_CHECKING:
    from sensor_msgs.msg import CameraInfo

Matrix = NDArray[np.float64]

# Models whose coefficients OpenCV's pinhole functions take as they are, with the counts it knows.
_MODELS = ("plumb_bob", "rational_polynomial")
_COEFFICIENTS = (0, 4, 5, 8, 12, 14)


def _resampling(scale_x: float, scale_y: float) -> Matrix:
    """Map homogeneous pixel coordinates of an image to those of its resized copy."""
    return np.array(
        [
            [scale_x, 0.0, (scale_x - 1.0) / 2.0],
            [0.0, scale_y, (scale_y - 1.0) / 2.0],
            [0.0, 0.0, 1.0],
        ]
    )


def scale(info: CameraInfo, scale_x: float, scale_y: float) -> None:
    """Turn the camera of an image into the camera of its resized copy, in place.

    Intrinsics `k`, projection `p` (with its translation, which scales as fx does), the region of
    interest and the size change; distortion acts before the intrinsics and stays. An uncalibrated
    camera, all zero, stays so.
    """
    resampling = _resampling(scale_x, scale_y)
    info.k = (resampling @ np.reshape(info.k, (3, 3))).ravel()
    info.p = (resampling @ np.reshape(info.p, (3, 4))).ravel()
    info.width = round(info.width * scale_x)
    info.height = round(info.height * scale_y)
    roi = info.roi
    roi.x_offset, roi.width = round(roi.x_offset * scale_x), round(roi.width * scale_x)
    roi.y_offset, roi.height = round(roi.y_offset * scale_y), round(roi.height * scale_y)


def matrix(info: CameraInfo) -> Matrix:
    """Return the intrinsics of the image as it was sent: after its region of interest and binning.

    Returns:
        The camera matrix, shape (3, 3), in pixels.

    Raises:
        ValueError: the camera is not calibrated.
    """
    return _as_sent(info, "k", (3, 3))


def _as_sent(info: CameraInfo, field: str, shape: tuple[int, int]) -> Matrix:
    """Return a matrix of the camera, after its region of interest and binning."""
    full = np.array(getattr(info, field), dtype=np.float64).reshape(shape)
    if full[0, 0] <= 0.0 or full[1, 1] <= 0.0:
        raise ValueError(
            "camera_info is not calibrated: its focal length "
            f"{field}[0] or {field}[{shape[1] + 1}] is 0"
        )
    full[0, 2] -= info.roi.x_offset
    full[1, 2] -= info.roi.y_offset
    # 0 means the same as 1: no binning.
    return _resampling(1.0 / max(info.binning_x, 1), 1.0 / max(info.binning_y, 1)) @ full


def rotation(info: CameraInfo) -> Matrix:
    """Return the rotation from the camera's optical frame to the rectified frame, (3, 3)."""
    return np.array(info.r, dtype=np.float64).reshape(3, 3)


def projection(info: CameraInfo) -> Matrix:
    """Return the camera of the rectified image, after its region of interest and binning.

    Returns:
        Shape (3, 4), in pixels; the last column is that of the right camera of a stereo pair,
        -fx times the baseline in metres.

    Raises:
        ValueError: the camera is not calibrated.
    """
    return _as_sent(info, "p", (3, 4))


def rectified(info: CameraInfo, width: int, height: int) -> None:
    """Turn the camera of an image into the camera of its rectified image, in place.

    Args:
        info: the camera.
        width: the width of the image as it was sent, pixels.
        height: the same.

    Raises:
        ValueError: the camera is not calibrated.
    """
    new = projection(info)
    info.p = new.ravel()
    info.k = new[:, :3].ravel()
    info.r = np.eye(3).ravel()
    info.d = np.zeros(5)
    info.distortion_model = "plumb_bob"
    info.width, info.height = width, height
    info.binning_x = info.binning_y = 0
    roi = info.roi
    roi.x_offset = roi.y_offset = roi.width = roi.height = 0


def distortion(info: CameraInfo) -> Matrix:
    """Return the distortion coefficients in OpenCV's order; empty for an ideal lens.

    Raises:
        ValueError: the model is not one of OpenCV's pinhole models.
    """
    coefficients = np.array(info.d, dtype=np.float64)
    if coefficients.any() and info.distortion_model not in _MODELS:
        raise ValueError(
            f"camera_info's distortion model {info.distortion_model!r} is not one of "
            f"{', '.join(_MODELS)}"
        )
    if coefficients.size not in _COEFFICIENTS:
        raise ValueError(
            f"camera_info has {coefficients.size} distortion coefficients; expected one of "
            f"{', '.join(map(str, _COEFFICIENTS))}"
        )
    return coefficients


# Cameras of a stereo rig with a colour camera, and some to spare.
_CACHED_CAMERAS = 8


def rectify(pixels: Pixels, info: CameraInfo, target: Pixels) -> None:
    """Write the rectified image into `target`, whose shape and type are those of `pixels`.

    Pixels that the camera did not see are 0.

    Raises:
        ValueError: the camera is not calibrated, or its distortion model is unknown.
    """
    height, width = pixels.shape[:2]
    # Arrays have no hash, by which the maps of a camera are found again.
    model = (
        tuple(part(info).ravel().tolist()) for part in (matrix, distortion, rotation, projection)
    )
    first, second = _maps(*model, (width, height))
    cv2.remap(
        pixels,
        first,
        second,
        cv2.INTER_LINEAR,
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
    """Return for each pixel of the rectified image its place in the image of the camera.

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
