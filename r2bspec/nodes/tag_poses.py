"""AprilTags in a gray image: which, and where.

The frame of a tag has its origin in the tag's centre, x to the right and y down in the tag's own
image as its authors print it, and z into the tag: a tag upright and square before the camera has
the identity rotation. Poses are in the camera's optical frame: x right, y down, z forward.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from r2bspec.nodes.images import cv2

FAMILIES = ("16h5", "25h9", "36h10", "36h11")

# The published code of each family's tag 0: its inner cells row by row, the first the highest bit.
_TAG_0 = MappingProxyType(
    {"16h5": 0x231B, "25h9": 0x155CBF1, "36h10": 0x1CA92A687, "36h11": 0xD5D628584}
)


@dataclass(frozen=True, slots=True)
class Detection:
    """One tag in an image.

    Attributes:
        id: the tag's number in its family.
        position_m: the tag's centre in the camera's optical frame, metres.
        quaternion_xyzw: rotation from the tag's frame to the camera's, of length 1, with w >= 0.
        corners_px: top left, top right, bottom right and bottom left of the black square, as (u, v)
            with the centre of the image's first pixel at (0, 0).
    """

    id: int
    position_m: tuple[float, float, float]
    quaternion_xyzw: tuple[float, float, float, float]
    corners_px: tuple[tuple[float, float], ...]


def detect(
    gray: NDArray[np.uint8],
    camera_matrix: NDArray[np.float64],
    distortion: NDArray[np.float64],
    family: str,
    size_m: float,
) -> list[Detection]:
    """Find the tags of one family.

    Args:
        gray: the image, shape (height, width).
        camera_matrix: shape (3, 3), pixels.
        distortion: 0, 4, 5, 8, 12 or 14 coefficients in OpenCV's order.
        family: one of `FAMILIES`.
        size_m: edge of the tag's black square, metres.

    Returns:
        The detections, by id; those of one id from left to right.

    Raises:
        ValueError: `family` is unknown.
    """
    found, ids, _ = _detector(family).detectMarkers(gray)
    if ids is None:
        return []
    turns = _quarter_turns(family)
    detections = []
    for tag_id, quad in zip(ids.ravel(), found, strict=True):
        corners = np.roll(np.array(quad, np.float64).reshape(4, 2), turns, axis=0)
        position, quaternion = pose(corners, camera_matrix, distortion, size_m)
        corners_px = tuple((float(u), float(v)) for u, v in corners)
        detections.append(Detection(int(tag_id), position, quaternion, corners_px))
    return sorted(detections, key=lambda tag: (tag.id, tag.corners_px))


def pose(
    corners_px: NDArray[np.float64],
    camera_matrix: NDArray[np.float64],
    distortion: NDArray[np.float64],
    size_m: float,
) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
    """Locate a square tag by its corners.

    Infinitesimal plane-based pose estimation (Collins and Bartoli, IJCV 2014); of its two solutions
    the one with the smaller reprojection error.

    Args:
        corners_px: top left, top right, bottom right, bottom left, shape (4, 2).
        camera_matrix: shape (3, 3), pixels.
        distortion: coefficients in OpenCV's order.
        size_m: edge of the square, metres.

    Returns:
        Position in metres and rotation as x, y, z, w: see `Detection`.
    """
    # OpenCV turns the rotation matrix that it finds into a vector, and gets half a turn wrong: with
    # y up, any tag that faces the camera. Hence the bottom corners come first: IPPE_SQUARE fixes
    # the points below but not what they mean, and now an upright tag has no rotation at all. Every
    # other one is taken as upright first, so that half a turn never occurs.
    turns = _turns_in_image(corners_px)
    bottom_left_first = np.roll(corners_px, turns, axis=0)[[3, 2, 1, 0]]
    half = size_m / 2.0
    square = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
    _, rotation, translation = cv2.solvePnP(
        square, bottom_left_first, camera_matrix, distortion, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    x, y, z = (float(value) for value in translation.ravel())
    return (x, y, z), _turned_about_z(_quaternion(rotation.ravel()), turns)


def _turns_in_image(corners_px: NDArray[np.float64]) -> int:
    """Clockwise quarter turns by which a tag appears turned in the image, to the nearest."""
    along_u, along_v = corners_px[1] - corners_px[0] + corners_px[2] - corners_px[3]
    return round(math.atan2(along_v, along_u) / (math.pi / 2.0))


def _quaternion(rotation_vector: NDArray[Any]) -> tuple[float, float, float, float]:
    """Turn an axis times an angle in radians into x, y, z, w."""
    angle = float(np.linalg.norm(rotation_vector))
    # sin(a/2) / a, which goes to 1/2; np.sinc(t) is sin(pi t) / (pi t).
    x, y, z = rotation_vector * float(np.sinc(angle / (2.0 * np.pi))) / 2.0
    return float(x), float(y), float(z), math.cos(angle / 2.0)


def _turned_about_z(
    q: tuple[float, float, float, float], turns: int
) -> tuple[float, float, float, float]:
    """Multiply a quaternion by quarter turns about z from the right; of the two signs, w >= 0."""
    x, y, z, w = q
    sine, cosine = math.sin(turns * math.pi / 4.0), math.cos(turns * math.pi / 4.0)
    turned = (
        x * cosine + y * sine,
        y * cosine - x * sine,
        z * cosine + w * sine,
        w * cosine - z * sine,
    )
    if turned[3] >= 0.0:
        return turned
    return -turned[0], -turned[1], -turned[2], -turned[3]


def _dictionary(family: str) -> Any:
    if family not in FAMILIES:
        raise ValueError(f"tag family {family!r} is not one of {', '.join(FAMILIES)}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_APRILTAG_{family}"))


@cache
def _detector(family: str) -> Any:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    # The border of an AprilTag is one cell wide inside and outside of its corners, so a window of
    # half a cell sees nothing but the corner; a smaller one, OpenCV's default, doubles the error
    # of distant tags.
    parameters.relativeCornerRefinmentWinSize = 0.5
    return cv2.aruco.ArucoDetector(_dictionary(family), parameters)


@cache
def _quarter_turns(family: str) -> int:
    return quarter_turns(_dictionary(family), family)


def quarter_turns(dictionary: Any, family: str) -> int:
    """Clockwise quarter turns from tags as a dictionary holds them to tags as they are printed.

    OpenCV's AprilTag dictionaries are upside down up to 5.0 (2) and upright after it (0), so this
    is found out and not assumed.
    """
    cells = dictionary.markerSize
    code = f"{_TAG_0[family]:0{cells * cells}b}"
    printed = np.array([int(cell) for cell in code]).reshape(cells, cells)
    dictionary_cells = cv2.aruco.generateImageMarker(dictionary, 0, cells + 2)[1:-1, 1:-1] > 0
    return next(
        turns for turns in range(4) if np.array_equal(np.rot90(dictionary_cells, -turns), printed)
    )
