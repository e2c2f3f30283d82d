"""Rotations, poses and the motion of the rig, in plain arithmetic.

This is plain Python, not numpy: there are only a few numbers a frame, and the rendered bytes must
not depend on a linear algebra library. Sine and cosine are computed here, too: those of the C
library differ in the last bit between processors and versions, which would change the content hash.

The body is x forward, y left, z up. Optical frames are x right, y down, z forward.
"""

from __future__ import annotations

import math

import msgspec

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

# Columns are the optical axes in body axes.
BODY_FROM_OPTICAL: Matrix = ((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))

GRAVITY_M_S2 = 9.80665

# Taylor: x - x^3/3! + x^5/5! - ... up to x^21; the rest is below 1e-17 for a quarter turn.
_COEFFICIENTS = tuple((-1) ** (power // 2) / math.factorial(power) for power in range(21, 0, -2))


def sine(angle: float) -> float:
    """Return the sine of an angle in radians, to within 1e-15 for angles of a few turns."""
    angle -= 2 * math.pi * round(angle / (2 * math.pi))
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
    """Return the cosine of an angle in radians, to within 1e-15 for angles of a few turns."""
    return sine(angle + math.pi / 2)


def apply(matrix: Matrix, vector: Vector) -> Vector:
    """Multiply a matrix and a column vector."""
    x, y, z = vector
    a, b, c = matrix
    return (
        a[0] * x + a[1] * y + a[2] * z,
        b[0] * x + b[1] * y + b[2] * z,
        c[0] * x + c[1] * y + c[2] * z,
    )


def transpose(matrix: Matrix) -> Matrix:
    """Transpose a matrix, which inverts a rotation."""
    a, b, c = matrix
    return ((a[0], b[0], c[0]), (a[1], b[1], c[1]), (a[2], b[2], c[2]))


def multiply(left: Matrix, right: Matrix) -> Matrix:
    """Multiply two matrices."""
    a, b, c = transpose(right)
    return transpose((apply(left, a), apply(left, b), apply(left, c)))


def from_yaw_pitch_roll(yaw: float, pitch: float, roll: float) -> Matrix:
    """Return world from body, in radians: Rz(yaw) Ry(pitch) Rx(roll); positive pitch looks down."""
    cy, sy = cosine(yaw), sine(yaw)
    cp, sp = cosine(pitch), sine(pitch)
    cr, sr = cosine(roll), sine(roll)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


class Pose(msgspec.Struct, frozen=True):
    """A rigid transform: point in parent = rotation * point in child + position."""

    position_m: Vector
    rotation: Matrix

    def apply(self, point: Vector) -> Vector:
        """Return a point of the child in the parent, metres."""
        x, y, z = apply(self.rotation, point)
        return (x + self.position_m[0], y + self.position_m[1], z + self.position_m[2])

    def compose(self, child: Pose) -> Pose:
        """Return the pose of the child's child in this pose's parent."""
        return Pose(self.apply(child.position_m), multiply(self.rotation, child.rotation))

    def inverse(self) -> Pose:
        """Return the pose of the parent in the child."""
        back = transpose(self.rotation)
        x, y, z = apply(back, self.position_m)
        return Pose((-x, -y, -z), back)


class Wave(msgspec.Struct, frozen=True):
    """A coordinate over time, a sine about zero, whose derivatives are known exactly."""

    amplitude: float
    hertz: float
    phase_rad: float

    def value(self, seconds: float) -> float:
        """Return the coordinate."""
        return self.amplitude * sine(2 * math.pi * self.hertz * seconds + self.phase_rad)

    def rate(self, seconds: float) -> float:
        """Return the first derivative of the coordinate, per second."""
        omega = 2 * math.pi * self.hertz
        return self.amplitude * omega * cosine(omega * seconds + self.phase_rad)

    def acceleration(self, seconds: float) -> float:
        """Return its second derivative, per second squared."""
        omega = 2 * math.pi * self.hertz
        return -omega * omega * self.value(seconds)


class Motion(msgspec.Struct, frozen=True):
    """The path of the body through the world, in metres and radians; it rests at the origin."""

    x: Wave
    y: Wave
    z: Wave
    yaw: Wave
    pitch: Wave
    roll: Wave

    def pose(self, seconds: float) -> Pose:
        """Return world from body at a time after the start of the sequence."""
        return Pose(
            (self.x.value(seconds), self.y.value(seconds), self.z.value(seconds)),
            from_yaw_pitch_roll(
                self.yaw.value(seconds), self.pitch.value(seconds), self.roll.value(seconds)
            ),
        )

    def angular_velocity_rad_s(self, seconds: float) -> Vector:
        """Return the angular velocity in body axes, from the rates of yaw, pitch and roll."""
        yaw, pitch, roll = (wave.rate(seconds) for wave in (self.yaw, self.pitch, self.roll))
        tilt, bank = self.pitch.value(seconds), self.roll.value(seconds)
        return (
            roll - yaw * sine(tilt),
            pitch * cosine(bank) + yaw * sine(bank) * cosine(tilt),
            yaw * cosine(bank) * cosine(tilt) - pitch * sine(bank),
        )

    def specific_force_m_s2(self, seconds: float) -> Vector:
        """Return the reading of an accelerometer at the origin of the body, in body axes."""
        x, y, z = (wave.acceleration(seconds) for wave in (self.x, self.y, self.z))
        return apply(transpose(self.pose(seconds).rotation), (x, y, z + GRAVITY_M_S2))
