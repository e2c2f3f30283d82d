"""Disparities and points, against scenes whose depth is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("cv2")

from r2bspec.nodes import stereo
from r2bspec.nodes.stereo import ValidWindow

WIDTH, HEIGHT = 320, 160


def texture(seed: int = 1) -> NDArray[np.uint8]:
    """Blocks of three pixels: sharp, and smooth enough for a matcher."""
    cells = np.random.default_rng(seed).integers(20, 235, (HEIGHT // 2, WIDTH), np.uint8)
    return np.repeat(np.repeat(cells, 2, axis=0), 3, axis=1)[:HEIGHT]


def pair(disparity_px: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """What both cameras see of a wall; the right image is cut from the same texture."""
    wall = texture()
    left = wall[:, 64 : 64 + WIDTH]
    right = wall[:, 64 + disparity_px : 64 + disparity_px + WIDTH]
    return np.ascontiguousarray(left), np.ascontiguousarray(right)


@pytest.mark.parametrize("true_px", [5, 12, 30])
def test_a_wall_has_the_disparity_of_its_distance(true_px: int) -> None:
    left, right = pair(true_px)
    found = stereo.disparity(stereo.make_matcher(64, 15), left, right)
    window = stereo.valid_window(64, 15, WIDTH, HEIGHT)
    inside = found[
        window.y : window.y + window.height, window.x : window.x + window.width - true_px
    ]
    assert (np.abs(inside - true_px) <= 1).mean() > 0.95
    # Swapped images show everything in the wrong direction: hardly anything is found there.
    swapped = stereo.disparity(stereo.make_matcher(64, 15), right, left)
    assert (np.abs(swapped - true_px) <= 1).mean() < 0.1


def test_what_has_no_match_is_below_zero() -> None:
    left, _ = pair(10)
    blank = np.full_like(left, 128)
    found = stereo.disparity(stereo.make_matcher(32, 15), blank, blank)
    assert (found == -1.0).all()


def test_different_principal_points_shift_every_disparity() -> None:
    left, right = pair(12)
    plain = stereo.disparity(stereo.make_matcher(32, 15), left, right)
    shifted = stereo.disparity(stereo.make_matcher(32, 15), left, right, 2.5)
    assert np.array_equal(shifted, plain - np.float32(2.5))


@pytest.mark.parametrize(("range_px", "window_px"), [(64, 15), (32, 9)])
def test_the_valid_window_is_that_of_opencv(range_px: int, window_px: int) -> None:
    cv2 = pytest.importorskip("cv2")
    full = (0, 0, WIDTH, HEIGHT)
    expected = cv2.getValidDisparityROI(full, full, 0, range_px, window_px)
    assert stereo.valid_window(range_px, window_px, WIDTH, HEIGHT) == ValidWindow(*expected)


def test_points_lie_on_the_rays_of_their_pixels_at_their_depth() -> None:
    projection = np.array([[120.0, 0, 30.5, 0], [0, 110.0, 21.25, 0], [0, 0, 1, 0]])
    disparity = np.random.default_rng(3).uniform(1, 60, (40, 60)).astype(np.float32)
    disparity[5, 7], disparity[6, 8] = -1.0, 0.0
    cloud = stereo.points(disparity, projection, 120.0, 0.15)
    assert cloud.shape == (40, 60)
    for row, column in ((0, 0), (39, 59), (12, 33)):
        x, y, z = (float(cloud[name][row, column]) for name in "xyz")
        assert z == pytest.approx(120.0 * 0.15 / disparity[row, column], rel=1e-6)
        seen = projection @ np.array([x, y, z, 1.0])
        assert seen[:2] / seen[2] == pytest.approx((column, row), abs=1e-3)
    for row, column in ((5, 7), (6, 8)):
        assert all(np.isnan(cloud[name][row, column]) for name in "xyz")
    assert np.isnan(cloud["z"]).sum() == 2


@pytest.mark.parametrize(
    ("encoding", "pixel"),
    [
        ("rgb8", (1, 2, 3)),
        ("bgr8", (3, 2, 1)),
        ("rgba8", (1, 2, 3, 9)),
        ("bgra8", (3, 2, 1, 9)),
    ],
)
def test_colours_are_packed_as_pcl_reads_them(encoding: str, pixel: tuple[int, ...]) -> None:
    pixels = np.array([[pixel]], np.uint8)
    assert stereo.colors(pixels, encoding).tolist() == [[0x010203]]
