"""Where in an image things lie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from r2bspec.datasets.scene.geometry import Vector
from r2bspec.datasets.scene.rig import Camera

# Nearer than this, perspective is no longer computed.
MIN_DEPTH_M = 0.05


@dataclass(frozen=True, slots=True)
class Bounds:
    """A rectangle of pixels, past-last at the bottom and right."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def columns(self) -> slice:
        """The columns inside."""
        return slice(self.left, self.right)


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
    bounds = Bounds(
        top=max(0, int(min(down)) - 1),
        bottom=min(camera.height, int(max(down)) + 2),
        left=max(0, int(min(across)) - 1),
        right=min(camera.width, int(max(across)) + 2),
    )
    return bounds if bounds.top < bounds.bottom and bounds.left < bounds.right else None
