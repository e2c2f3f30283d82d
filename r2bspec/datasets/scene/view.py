"""Where in an image things lie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

from r2bspec.datasets.scene.geometry import Vector
from r2bspec.datasets.scene.rig import Camera

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# What tangential distortion may add to what `_Reach` says, in pixels.
_MARGIN_PX = 4

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


@dataclass(frozen=True, slots=True)
class _Reach:
    """How far an ideal camera would see what a lens shows, and how much that lens scales.

    Attributes:
        across: largest distance from the axis, one focal length away.
        down: the same.
        scales: smallest and largest ratio of where a point is shown to where it would be.
    """

    across: float
    down: float
    scales: tuple[float, float]


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
    return camera.lens.undistort(*(np.array(each) for each in np.broadcast_arrays(x, y)))


@lru_cache(maxsize=8)
def _reach(camera: Camera) -> _Reach:
    """From the edge of the image, where the distortion is largest."""
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
    return _Reach(across, down, (low, high))


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
        reach, margin = _reach(camera), _MARGIN_PX
        across = _shown(across, camera.center_px[0], camera.focal_px * reach.across, reach.scales)
        down = _shown(down, camera.center_px[1], camera.focal_px * reach.down, reach.scales)
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
    ends = [min(max(each - center_px, -reach_px), reach_px) for each in (min(pixels), max(pixels))]
    places = [center_px + end * scale for end in ends for scale in scales]
    return [min(places), max(places)]
