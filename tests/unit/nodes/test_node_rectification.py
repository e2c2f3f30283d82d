"""Rectification, against a camera model that is written out here."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("cv2")

import cameras

from r2bspec.nodes import camera

WIDTH, HEIGHT = 160, 120
K = np.array([[100.0, 0.0, 82.0], [0.0, 105.0, 57.0], [0.0, 0.0, 1.0]])
D = np.array([-0.21, 0.05, 0.002, -0.003, 0.0])


def turned(degrees: float) -> NDArray[np.float64]:
    """A rotation about the vertical axis."""
    a = np.radians(degrees)
    return np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])


def camera_info(**fields: Any) -> SimpleNamespace:
    """A small camera with a lens, beside another."""
    p = np.array([[90.0, 0.0, 79.0, -9.0], [0.0, 90.0, 60.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    small = {"width": WIDTH, "height": HEIGHT, "d": D, "k": K.ravel(), "p": p.ravel()}
    return cameras.camera_info(**{**small, "r": turned(3.0).ravel(), **fields})


def seen_at(info: SimpleNamespace) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """For each rectified pixel, its place in the camera's image: Brown's model, step by step."""
    p = np.reshape(info.p, (3, 4))
    v, u = np.mgrid[0 : info.height, 0 : info.width].astype(float)
    rays = np.stack([(u - p[0, 2]) / p[0, 0], (v - p[1, 2]) / p[1, 1], np.ones_like(u)], axis=-1)
    turned_back = rays @ np.reshape(info.r, (3, 3))  # the transpose applied from the left
    x, y = turned_back[..., 0] / turned_back[..., 2], turned_back[..., 1] / turned_back[..., 2]
    k1, k2, p1, p2, k3 = info.d
    square = x**2 + y**2
    scale = 1 + k1 * square + k2 * square**2 + k3 * square**3
    shown_x = x * scale + 2 * p1 * x * y + p2 * (square + 2 * x**2)
    shown_y = y * scale + p1 * (square + 2 * y**2) + 2 * p2 * x * y
    k = np.reshape(info.k, (3, 3))
    return k[0, 0] * shown_x + k[0, 2], k[1, 1] * shown_y + k[1, 2]


@pytest.mark.parametrize("axis", [0, 1])
def test_each_pixel_shows_what_the_camera_saw_along_its_ray(axis: int) -> None:
    # Each pixel holds its own column, or row, which linear interpolation reproduces.
    info = camera_info()
    ramp = np.mgrid[0:HEIGHT, 0:WIDTH][1 - axis].astype(np.float32)
    target = np.empty_like(ramp)
    camera.rectify(ramp, info, target)
    expected = seen_at(info)
    inside = (
        (expected[0] > 1)
        & (expected[0] < WIDTH - 2)
        & (expected[1] > 1)
        & (expected[1] < HEIGHT - 2)
    )
    assert inside.mean() > 0.5
    # The maps are exact to 1/32 pixel.
    assert np.abs(target - expected[axis])[inside].max() < 0.04
    # Without the lens, or without the rotation, the image would be another.
    for wrong in (camera_info(d=np.zeros(5)), camera_info(r=np.eye(3).ravel())):
        assert np.abs(seen_at(wrong)[axis] - expected[axis])[inside].max() > 1


def test_the_rectified_camera_has_no_distortion_and_keeps_the_baseline() -> None:
    info = camera_info()
    camera.rectified(info, WIDTH, HEIGHT)
    assert not np.any(info.d)
    assert np.array_equal(np.reshape(info.r, (3, 3)), np.eye(3))
    assert np.array_equal(camera.matrix(info), np.reshape(info.p, (3, 4))[:, :3])
    assert info.p[3] == -9.0
    assert camera.distortion(info).tolist() == [0.0] * 5


def test_binned_and_cropped_images_have_their_own_camera() -> None:
    roi = SimpleNamespace(x_offset=20, y_offset=10, width=100, height=80)
    info = camera_info(roi=roi, binning_x=2, binning_y=2)
    camera.rectified(info, 50, 40)
    # A pixel of the binned image covers two, and its centre lies between them.
    assert info.p[2] == pytest.approx((79.0 - 20) / 2 - 0.25)
    assert info.p[0] == pytest.approx(45.0)
    assert (info.width, info.height, info.roi.x_offset, info.binning_x) == (50, 40, 0, 0)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"p": np.zeros(12)}, "not calibrated"),
        ({"k": np.zeros(9)}, "not calibrated"),
        ({"distortion_model": "equidistant"}, "distortion model 'equidistant'"),
    ],
)
def test_an_unusable_camera_is_refused(fields: dict[str, Any], message: str) -> None:
    pixels = np.zeros((HEIGHT, WIDTH), np.uint8)
    with pytest.raises(ValueError, match=message):
        camera.rectify(pixels, camera_info(**fields), np.empty_like(pixels))
