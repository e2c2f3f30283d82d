"""Synthetic photographs of AprilTags, for tests that know where the tag is."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Matrix = NDArray[np.float64]

WIDTH, HEIGHT = 1280, 720
CAMERA = np.array([[640.0, 0.0, 652.0], [0.0, 645.0, 351.5], [0.0, 0.0, 1.0]])
_OVERSAMPLING = 3
_CELL_PX = 60


def cells_of_code(code: int, edge: int) -> NDArray[Any]:
    """The cells of a tag as it is printed, black border included, from its published code."""
    inner = np.array([int(bit) for bit in f"{code:0{edge * edge}b}"]).reshape(edge, edge)
    return np.pad(inner, 1)


def rotation_xyz(x: float, y: float, z: float) -> Matrix:
    """Rotation matrix of a rotation vector in radians."""
    return np.asarray(Rotation.from_rotvec((x, y, z)).as_matrix(), np.float64)


def photograph(
    cells: NDArray[Any], rotation: Matrix, position_m: Matrix, size_m: float, noise: float = 2.0
) -> NDArray[np.uint8]:
    """Gray image of a tag on white paper before a blotchy wall; noise in gray levels."""
    random = np.random.default_rng(7)
    canvas = cv2.resize(
        random.integers(60, 200, (45, 80)).astype(np.uint8),
        (WIDTH * _OVERSAMPLING, HEIGHT * _OVERSAMPLING),
        interpolation=cv2.INTER_CUBIC,
    )
    paper = np.kron(np.pad(cells, 1, constant_values=1), np.ones((_CELL_PX, _CELL_PX)))
    m_per_px = size_m / (len(cells) * _CELL_PX)
    # Pixel centres of the paper to metres in the tag's frame, whose origin is the paper's centre.
    offset_m = (0.5 - len(paper) / 2) * m_per_px
    to_metres = np.array([[m_per_px, 0, offset_m], [0, m_per_px, offset_m], [0, 0, 1]])
    to_image = CAMERA @ np.column_stack([rotation[:, 0], rotation[:, 1], position_m])
    shift = (_OVERSAMPLING - 1) / 2
    oversample = np.array([[_OVERSAMPLING, 0, shift], [0, _OVERSAMPLING, shift], [0, 0, 1]])
    cv2.warpPerspective(
        (paper * 235 + 10).astype(np.uint8),
        oversample @ to_image @ to_metres,
        (canvas.shape[1], canvas.shape[0]),
        dst=canvas,
        borderMode=cv2.BORDER_TRANSPARENT,
    )
    image = cv2.resize(canvas, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    noisy = image + random.normal(0.0, noise, image.shape)
    photo: NDArray[np.uint8] = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    return photo


def angle_deg(xyzw: tuple[float, ...], rotation: Matrix) -> float:
    """Angle between a unit quaternion and a rotation matrix."""
    difference = Rotation.from_quat(xyzw).inv() * Rotation.from_matrix(rotation)
    return float(np.degrees(difference.magnitude()))
