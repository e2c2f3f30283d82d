"""The lenses of the rig distort as OpenCV's model does; sines are the same on every machine."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from r2bspec.datasets import rig
from r2bspec.datasets.cameras import (
    Camera,
    Lens,
    camera_pose,
    cosine,
    image_bounds,
    project,
    sine,
    undistorted,
)
from r2bspec.datasets.scenes import find_scene
from r2bspec.datasets.sensors import render_depth

HAWK = (rig.LEFT_HAWK, rig.RIGHT_HAWK)


def lens_of(camera: Camera) -> Lens:
    assert camera.lens is not None
    return camera.lens


def matrix_of(camera: Camera) -> NDArray[np.float64]:
    (cx, cy), focal = camera.center_px, camera.focal_px
    return np.array([[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("camera", HAWK)
def test_points_appear_where_opencv_projects_them(camera: Camera) -> None:
    cv2 = pytest.importorskip("cv2")
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-4, 4, (50, 2)), rng.uniform(4, 9, 50)])
    coefficients = np.array(lens_of(camera).coefficients)
    expected, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), matrix_of(camera), coefficients
    )
    found = [project(camera, (float(x), float(y), float(z))) for x, y, z in points]
    np.testing.assert_allclose(found, expected.reshape(-1, 2), atol=1e-9)


@pytest.mark.parametrize("camera", HAWK)
def test_the_inverse_is_one_up_to_the_corners(camera: Camera) -> None:
    columns, rows = np.linspace(0, camera.width - 1, 40), np.linspace(0, camera.height - 1, 30)
    x, y = undistorted(camera, columns, rows)
    for row, line in enumerate(rows):
        for column, place in enumerate(columns):
            point = (float(x[row, column]), float(y[row, column]), 1.0)
            assert project(camera, point) == pytest.approx((place, line), abs=0.001)


@pytest.mark.parametrize("camera", HAWK)
def test_bounds_contain_every_pixel_of_every_box(camera: Camera) -> None:
    """Boxes are looked for inside their bounds only: the depth must be that of the whole search."""
    scene = find_scene("r2b_datacenter")
    pose = camera_pose(scene.motion.pose(2.0), camera)
    inverse = pose.inverse()
    seen = 0
    for box in scene.room.boxes:
        corners = [inverse.apply(corner) for corner in box.corners]
        if any(z < 0.3 for _, _, z in corners):
            continue
        bounds = image_bounds(camera, corners)
        # Points all over the box, those on its edges among them.
        low, high = np.array(box.low_m), np.array(box.high_m)
        for share in np.stack(np.meshgrid(*[np.linspace(0, 1, 9)] * 3), -1).reshape(-1, 3):
            point = inverse.apply(tuple(float(v) for v in low + (high - low) * share))  # type: ignore[arg-type]
            x, y = point[0] / point[2], point[1] / point[2]
            if abs(x) > 1.2 or abs(y) > 0.8:
                continue  # outside of the image, where the polynomial means nothing
            u, v = project(camera, point)
            if 0 <= u <= camera.width - 1 and 0 <= v <= camera.height - 1:
                seen += 1
                assert bounds is not None
                assert bounds.left <= u < bounds.right
                assert bounds.top <= v < bounds.bottom
    assert seen > 500
    assert render_depth(scene.room, camera, pose).min() > 0


@given(st.floats(-60, 60))
def test_agree_with_the_c_library(angle: float) -> None:
    assert sine(angle) == pytest.approx(math.sin(angle), abs=2e-14)
    assert cosine(angle) == pytest.approx(math.cos(angle), abs=2e-14)


@given(st.floats(-math.pi, math.pi))
def test_are_exact_within_a_turn(angle: float) -> None:
    assert sine(angle) == pytest.approx(math.sin(angle), abs=1e-15)
