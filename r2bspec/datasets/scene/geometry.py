"""Rotations and poses in plain floats.

Plain Python, and not numpy: these are a few numbers a frame, and no linear algebra library may
have a say in the bytes that are rendered.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from r2bspec.datasets.scene.waves import cosine, sine

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

# Columns are the optical axes (x right, y down, z forward) in body axes (x forward, y left, z up).
BODY_FROM_OPTICAL: Matrix = ((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))


def apply(matrix: Matrix, vector: Vector) -> Vector:
    """Matrix times column vector."""
    x, y, z = vector
    a, b, c = matrix
    return (
        a[0] * x + a[1] * y + a[2] * z,
        b[0] * x + b[1] * y + b[2] * z,
        c[0] * x + c[1] * y + c[2] * z,
    )


def multiply(left: Matrix, right: Matrix) -> Matrix:
    """Matrix times matrix."""
    columns = transpose(right)
    return transpose((apply(left, columns[0]), apply(left, columns[1]), apply(left, columns[2])))


def transpose(matrix: Matrix) -> Matrix:
    """The transpose; for a rotation, its inverse."""
    a, b, c = matrix
    return ((a[0], b[0], c[0]), (a[1], b[1], c[1]), (a[2], b[2], c[2]))


def add(left: Vector, right: Vector) -> Vector:
    """Sum of vectors."""
    return (left[0] + right[0], left[1] + right[1], left[2] + right[2])


def subtract(left: Vector, right: Vector) -> Vector:
    """Difference of vectors."""
    return (left[0] - right[0], left[1] - right[1], left[2] - right[2])


def from_yaw_pitch_roll(yaw: float, pitch: float, roll: float) -> Matrix:
    """World from body, in radians: Rz(yaw) Ry(pitch) Rx(roll); positive pitch looks down."""
    cy, sy = cosine(yaw), sine(yaw)
    cp, sp = cosine(pitch), sine(pitch)
    cr, sr = cosine(roll), sine(roll)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def quaternion(matrix: Matrix) -> tuple[float, float, float, float]:
    """Unit quaternion (x, y, z, w) of a rotation, with w not negative."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrix
    # The largest of the four is found first: dividing by a small one would lose digits.
    squares = (1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz)
    largest = squares.index(max(squares))
    rows = (
        (squares[0], xy + yx, xz + zx, zy - yz),
        (xy + yx, squares[1], yz + zy, xz - zx),
        (xz + zx, yz + zy, squares[2], yx - xy),
        (zy - yz, xz - zx, yx - xy, squares[3]),
    )
    x, y, z, w = rows[largest]
    scale = math.copysign(0.5 / math.sqrt(squares[largest]), w or 1.0)
    return (x * scale, y * scale, z * scale, w * scale)


@dataclass(frozen=True, slots=True)
class Pose:
    """A rigid transform: point in parent = rotation * point in child + position."""

    position_m: Vector
    rotation: Matrix

    def compose(self, child: Pose) -> Pose:
        """The pose of the child's child in this pose's parent."""
        return Pose(self.apply(child.position_m), multiply(self.rotation, child.rotation))

    def inverse(self) -> Pose:
        """The pose of the parent in the child."""
        back = transpose(self.rotation)
        return Pose(apply(back, subtract((0.0, 0.0, 0.0), self.position_m)), back)

    def apply(self, point: Vector) -> Vector:
        """A point of the child in the parent, metres."""
        return add(apply(self.rotation, point), self.position_m)
