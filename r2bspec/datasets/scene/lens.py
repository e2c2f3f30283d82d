"""The distortion of a lens: the model that ROS calls plumb_bob.

With (x, y) where an ideal camera would see a point, on the plane one focal length away, and
r^2 = x^2 + y^2, the lens shows it at

    x' = x s + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = y s + p1 (r^2 + 2 y^2) + 2 p2 x y      with s = 1 + k1 r^2 + k2 r^4 + k3 r^6

(Brown, 1966; OpenCV's `calib3d` and image_geometry use the same). Sums and products only, in a
fixed order, so that every machine gets the same bytes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

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
