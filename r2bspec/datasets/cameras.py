"""Poses, how the rig moves, and where in an image things lie, in plain arithmetic.

Plain Python, and not numpy: these are a few numbers a frame, and no linear algebra library may
have a say in the bytes that are rendered. Sine and cosine are computed here, too: those of the C
library differ in the last bit between processors and versions, and a content hash sees every bit.
Sums and products of floats are the same everywhere. The motion is a sum of sines, so that every
derivative is known exactly.

The distortion of a lens is the model that ROS calls plumb_bob. With (x, y) where an ideal camera
would see a point, on the plane one focal length away, and r^2 = x^2 + y^2, the lens shows it at

    x' = x s + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = y s + p1 (r^2 + 2 y^2) + 2 p2 x y      with s = 1 + k1 r^2 + k2 r^4 + k3 r^6

(Brown, 1966; OpenCV's `calib3d` and image_geometry use the same). Sums and products only, in a
fixed order, so that every machine gets the same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import msgspec

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


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


# Each step divides the error by three or more where the lenses of the rig distort most.
_INVERSION_STEPS = 16


class Lens(msgspec.Struct, frozen=True):
    """Five coefficients, named as in OpenCV."""

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float

    @property
    def coefficients(self) -> tuple[float, float, float, float, float]:
        """In the order of CameraInfo.d."""
        return (self.k1, self.k2, self.p1, self.p2, self.k3)

    def distort(self, x: float, y: float) -> tuple[float, float]:
        """Where the lens shows what an ideal camera sees at (x, y)."""
        square = x * x + y * y
        scale = 1 + square * (self.k1 + square * (self.k2 + square * self.k3))
        return (
            x * scale + 2 * self.p1 * x * y + self.p2 * (square + 2 * x * x),
            y * scale + self.p1 * (square + 2 * y * y) + 2 * self.p2 * x * y,
        )

    def undistort(
        self, x: NDArray[np.float64], y: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where an ideal camera sees what the lens shows at (x, y), to 1e-6; arrays of one shape.

        By fixed-point iteration, which converges where the distortion is less than half of what
        would fold the image.
        """
        ideal_x, ideal_y = x, y
        for _ in range(_INVERSION_STEPS):
            square = ideal_x * ideal_x + ideal_y * ideal_y
            scale = 1 + square * (self.k1 + square * (self.k2 + square * self.k3))
            across = 2 * self.p1 * ideal_x * ideal_y + self.p2 * (square + 2 * ideal_x * ideal_x)
            down = self.p1 * (square + 2 * ideal_y * ideal_y) + 2 * self.p2 * ideal_x * ideal_y
            ideal_x, ideal_y = (x - across) / scale, (y - down) / scale
        return ideal_x, ideal_y


_CHANNELS = {"rgb8": 3, "mono8": 1, "16UC1": 2}


class Camera(msgspec.Struct, frozen=True):
    """A pinhole camera, with a lens that distorts or none.

    Attributes:
        frame_id: its optical frame.
        encoding: of its images.
        focal_px: the same in x and y.
        center_px: principal point (cx, cy).
        position_m: of its optical centre in the body frame.
        baseline_m: distance to the left camera of the pair; zero for any other camera.
        lens: what distorts its images; None for images that its driver has rectified.
    """

    frame_id: str
    width: int
    height: int
    encoding: str
    focal_px: float
    center_px: tuple[float, float]
    position_m: tuple[float, float, float]
    baseline_m: float = 0.0
    lens: Lens | None = None

    @property
    def bytes_per_pixel(self) -> int:
        """Size of one pixel in its encoding."""
        return _CHANNELS[self.encoding]


# What tangential distortion may add to what `_reach` says, in pixels.
_MARGIN_PX = 4

# Nearer than this, perspective is no longer computed.
MIN_DEPTH_M = 0.05


class Bounds(msgspec.Struct, frozen=True):
    """A rectangle of pixels, past-last at the bottom and right."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def columns(self) -> slice:
        """The columns inside."""
        return slice(self.left, self.right)


def camera_pose(body: Pose, camera: Camera) -> Pose:
    """World from the camera's optical frame, given world from body."""
    return body.compose(Pose(camera.position_m, BODY_FROM_OPTICAL))


def project(camera: Camera, point_m: Vector) -> tuple[float, float]:
    """The pixel at which a camera shows a point of its optical frame, which is before it."""
    x, y = point_m[0] / point_m[2], point_m[1] / point_m[2]
    if camera.lens is not None:
        x, y = camera.lens.distort(x, y)
    return (
        camera.focal_px * x + camera.center_px[0],
        camera.focal_px * y + camera.center_px[1],
    )


def undistorted(
    camera: Camera, columns: NDArray[np.float64], rows: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The rays of pixels, at whole numbers or between them, one focal length away.

    Returns:
        x and y, which broadcast to (rows, columns).
    """
    import numpy as np

    x = ((columns - camera.center_px[0]) / camera.focal_px)[None, :]
    y = ((rows - camera.center_px[1]) / camera.focal_px)[:, None]
    if camera.lens is None:
        return x, y
    return camera.lens.undistort(*(np.array(part) for part in np.broadcast_arrays(x, y)))


@lru_cache(maxsize=8)
def _reach(camera: Camera) -> tuple[float, float, tuple[float, float]]:
    """How far an ideal camera would see what a lens shows, and how much that lens scales.

    From the edge of the image, where the distortion is largest.

    Returns:
        Largest distance from the axis across and down, one focal length away; smallest and largest
        ratio of where a point is shown to where it would be.
    """
    import numpy as np

    columns = np.arange(camera.width, dtype=np.float64)
    rows = np.arange(camera.height, dtype=np.float64)
    edges = [(columns, rows[[0, -1]]), (columns[[0, -1]], rows)]
    across = down = 0.0
    low = high = 1.0
    for edge_columns, edge_rows in edges:
        x, y = undistorted(camera, edge_columns, edge_rows)
        across = max(across, float(np.abs(x).max()))
        down = max(down, float(np.abs(y).max()))
        shown_x = (edge_columns - camera.center_px[0])[None, :] / camera.focal_px
        shown_y = (edge_rows - camera.center_px[1])[:, None] / camera.focal_px
        scales = np.sqrt((shown_x**2 + shown_y**2) / (x**2 + y**2))
        low, high = min(low, float(scales.min())), max(high, float(scales.max()))
    return across, down, (low, high)


def image_bounds(camera: Camera, points_m: Sequence[Vector]) -> Bounds | None:
    """The pixels that the hull of points may touch; None where that is outside the image.

    Args:
        camera: the camera.
        points_m: in its optical frame. If one is behind or too near, the whole image is given.
    """
    if any(z < MIN_DEPTH_M for _, _, z in points_m):
        return Bounds(0, camera.height, 0, camera.width)
    across = [camera.focal_px * x / z + camera.center_px[0] for x, _, z in points_m]
    down = [camera.focal_px * y / z + camera.center_px[1] for _, y, z in points_m]
    margin = 0
    if camera.lens is not None:
        (reach_across, reach_down, scales), margin = _reach(camera), _MARGIN_PX
        across = _shown(across, camera.center_px[0], camera.focal_px * reach_across, scales)
        down = _shown(down, camera.center_px[1], camera.focal_px * reach_down, scales)
    bounds = Bounds(
        top=max(0, int(min(down)) - 1 - margin),
        bottom=min(camera.height, int(max(down)) + 2 + margin),
        left=max(0, int(min(across)) - 1 - margin),
        right=min(camera.width, int(max(across)) + 2 + margin),
    )
    return bounds if bounds.top < bounds.bottom and bounds.left < bounds.right else None


def _shown(
    pixels: Sequence[float], center_px: float, reach_px: float, scales: tuple[float, float]
) -> list[float]:
    """The range in which a lens may show what lies between ideal coordinates."""
    ends = [min(max(end - center_px, -reach_px), reach_px) for end in (min(pixels), max(pixels))]
    places = [center_px + end * scale for end in ends for scale in scales]
    return [min(places), max(places)]
