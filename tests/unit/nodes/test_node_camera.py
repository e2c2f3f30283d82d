"""Cameras of resized, cropped and binned images."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("cv2")

from cameras import camera_info, message

from nightly import sampled
from r2bspec.nodes import camera, images


@pytest.mark.parametrize(
    ("width", "height"), sampled([(320, 600), (1600, 1000), (640, 400), (1280, 720)], 2)
)
@pytest.mark.parametrize(
    ("interpolation", "tolerance_px"), [(0, 0.51), (1, 0.005), (2, 0.06), (3, 0.11), (4, 0.06)]
)
def test_a_pixel_of_the_resized_image_sees_along_its_own_ray(
    width: int, height: int, interpolation: int, tolerance_px: float
) -> None:
    # Each pixel holds the x, then the y, of its ray at z = 1. Linear interpolation keeps a linear
    # image linear, and the others nearly, so after resizing each pixel must hold its ray in the
    # scaled camera.
    info = camera_info()
    scaled = camera_info()
    camera.scale(scaled, width / info.width, height / info.height)
    inverse, inverse_scaled = (np.linalg.inv(camera.matrix(one)) for one in (info, scaled))
    v, u = np.mgrid[0:800, 0:1280]
    for axis in (0, 1):
        rays = (inverse[axis, axis] * (u if axis == 0 else v) + inverse[axis, 2]).astype(np.float32)
        data = images.resize(message(rays, "32FC1"), width, height, interpolation)
        resized = np.frombuffer(data, np.float32).reshape(height, width)
        pixel = np.arange(height if axis else width)
        expected = inverse_scaled[axis, axis] * pixel + inverse_scaled[axis, 2]
        # Off the edge, where there is nothing to interpolate with.
        line = (resized[:, width // 2] if axis else resized[height // 2])[8:-8]
        np.testing.assert_allclose(line, expected[8:-8], rtol=0, atol=tolerance_px / 640)


def test_projected_points_move_with_the_pixels() -> None:
    info = camera_info()
    point = np.array([0.3, -0.2, 2.0, 1.0])
    before = np.reshape(info.p, (3, 4)) @ point
    camera.scale(info, 0.5, 0.9)
    after = np.reshape(info.p, (3, 4)) @ point
    u, v = before[:2] / before[2]
    assert after[:2] / after[2] == pytest.approx([(u + 0.5) * 0.5 - 0.5, (v + 0.5) * 0.9 - 0.5])


def test_an_uncalibrated_camera_stays_so_and_is_refused() -> None:
    info = camera_info(k=[0.0] * 9, p=[0.0] * 12)
    camera.scale(info, 0.5, 0.5)
    assert not info.k.any()
    with pytest.raises(ValueError, match="not calibrated"):
        camera.matrix(info)


@pytest.mark.parametrize(
    ("model", "d", "words"),
    [
        ("equidistant", [0.1] * 4, "'equidistant' is not one of plumb_bob, rational_polynomial"),
        ("plumb_bob", [0.1] * 6, "6 distortion coefficients; expected one of 0, 4, 5, 8, 12, 14"),
    ],
)
def test_distortion_that_opencv_would_misread_is_refused(
    model: str, d: list[float], words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        camera.distortion(camera_info(distortion_model=model, d=d))
