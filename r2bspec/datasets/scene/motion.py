"""Poses, and how the rig moves through the world, in plain arithmetic.

Plain Python, and not numpy: these are a few numbers a frame, and no linear algebra library may
have a say in the bytes that are rendered. Sine and cosine are computed here, too: those of the C
library differ in the last bit between processors and versions, and a content hash sees every bit.
Sums and products of floats are the same everywhere. The motion is a sum of sines, so that every
derivative is known exactly.
"""

from __future__ import annotations

import math

import msgspec

_TURN = 2 * math.pi

# Taylor: x - x^3/3! + x^5/5! - ... up to x^21; the rest is below 1e-17 for a quarter turn.
_COEFFICIENTS = tuple((-1) ** (power // 2) / math.factorial(power) for power in range(21, 0, -2))


def sine(angle: float) -> float:
    """Sine of an angle in radians, to within 1e-15 for angles of a few turns."""
    angle -= _TURN * round(angle / _TURN)
    if angle > math.pi / 2:
        angle = math.pi - angle
    elif angle < -math.pi / 2:
        angle = -math.pi - angle
    square = angle * angle
    total = 0.0
    for coefficient in _COEFFICIENTS:
        total = total * square + coefficient
    return total * angle


def cosine(angle: float) -> float:
    """Cosine of an angle in radians, to within 1e-15 for angles of a few turns."""
    return sine(angle + math.pi / 2)


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


class Pose(msgspec.Struct, frozen=True):
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


GRAVITY_M_S2 = 9.80665


class Track(msgspec.Struct, frozen=True):
    """One coordinate over time: a rest value and waves of (amplitude, hertz, phase in radians)."""

    rest: float
    waves: tuple[tuple[float, float, float], ...] = ()

    def at(self, seconds: float) -> tuple[float, float, float]:
        """Value and first and second derivative, in the track's unit and seconds."""
        value, speed, acceleration = self.rest, 0.0, 0.0
        for amplitude, hertz, phase in self.waves:
            omega = 2 * math.pi * hertz
            wave = amplitude * sine(omega * seconds + phase)
            value += wave
            speed += amplitude * omega * cosine(omega * seconds + phase)
            acceleration -= omega * omega * wave
        return value, speed, acceleration

    def value(self, seconds: float) -> float:
        """The value alone, with the bits that `at` gives."""
        value = self.rest
        for amplitude, hertz, phase in self.waves:
            value += amplitude * sine(2 * math.pi * hertz * seconds + phase)
        return value


class Motion(msgspec.Struct, frozen=True):
    """The body's path through the world: metres and radians."""

    x: Track
    y: Track
    z: Track
    yaw: Track
    pitch: Track
    roll: Track

    def pose(self, seconds: float) -> Pose:
        """World from body at a time after the sequence's start."""
        return Pose(
            (self.x.value(seconds), self.y.value(seconds), self.z.value(seconds)),
            from_yaw_pitch_roll(
                self.yaw.value(seconds), self.pitch.value(seconds), self.roll.value(seconds)
            ),
        )

    def angular_velocity_rad_s(self, seconds: float) -> Vector:
        """Angular velocity in body axes, from the derivatives of yaw, pitch and roll."""
        _, yaw_rate, _ = self.yaw.at(seconds)
        pitch, pitch_rate, _ = self.pitch.at(seconds)
        roll, roll_rate, _ = self.roll.at(seconds)
        return (
            roll_rate - yaw_rate * sine(pitch),
            pitch_rate * cosine(roll) + yaw_rate * sine(roll) * cosine(pitch),
            yaw_rate * cosine(roll) * cosine(pitch) - pitch_rate * sine(roll),
        )

    def specific_force_m_s2(self, seconds: float) -> Vector:
        """What an accelerometer at the origin reads: acceleration less gravity, body axes."""
        force = (
            self.x.at(seconds)[2],
            self.y.at(seconds)[2],
            self.z.at(seconds)[2] + GRAVITY_M_S2,
        )
        return apply(transpose(self.pose(seconds).rotation), force)
