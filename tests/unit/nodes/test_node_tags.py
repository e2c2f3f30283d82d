"""Tags found in rendered photographs whose geometry is known."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("cv2")

import cv2
from tag_rendering import CAMERA, Matrix, angle_deg, cells_of_code, photograph, rotation_xyz

from nightly import sampled
from r2bspec.nodes import tag_poses

SIZE_M = 0.162
NO_DISTORTION = np.zeros(5)
# Codes published with AprilTag, the first of their families but where said otherwise.
PUBLISHED = {
    ("16h5", 0): (0x231B, 4),
    ("25h9", 0): (0x155CBF1, 5),
    ("36h10", 0): (0x1CA92A687, 6),
    ("36h11", 0): (0xD5D628584, 6),
    ("36h11", 1): (0xD97F18B49, 6),
}

HALF_M = SIZE_M / 2
# Top left, top right, bottom right, bottom left, in the frame of the tag.
SQUARE = np.array(
    [[-HALF_M, -HALF_M, 0], [HALF_M, -HALF_M, 0], [HALF_M, HALF_M, 0], [-HALF_M, HALF_M, 0]]
)


def project_square(rotation: Matrix, position_m: Matrix) -> Matrix:
    """Pixels of the tag's corners, shape (4, 2), through a lens without distortion."""
    rays = SQUARE @ rotation.T + position_m
    pixels: Matrix = (rays @ CAMERA.T)[:, :2] / rays[:, 2:]
    return pixels


# Tolerances for a tag of 0.162 m up to 2 m away, seen with a focal length of 640 pixels.
POSITION_SHARE = 0.01
ANGLE_DEG = 1.5


@pytest.mark.parametrize(("family", "tag_id"), PUBLISHED)
def test_an_upright_tag_before_the_camera_has_no_rotation(family: str, tag_id: int) -> None:
    cells = cells_of_code(*PUBLISHED[family, tag_id])
    position = np.array([0.05, -0.03, 0.8])
    image = photograph(cells, np.eye(3), position, SIZE_M)
    (found,) = tag_poses.detect(image, CAMERA, NO_DISTORTION, family, SIZE_M)
    assert found.id == tag_id
    assert found.position_m == pytest.approx(position, abs=POSITION_SHARE * 0.8)
    assert angle_deg(found.quaternion_xyzw, np.eye(3)) < ANGLE_DEG


@pytest.mark.parametrize("distance_m", sampled([2.0, 1.0, 0.5], 3))
@pytest.mark.parametrize(
    "tilt", [(0.5, 0.0, 0.0), (0.0, -0.6, 0.3), (0.4, 0.4, 1.6), (0.2, -0.3, -2.8)]
)
def test_a_tilted_tag_is_where_it_was_rendered(
    tilt: tuple[float, float, float], distance_m: float
) -> None:
    rotation = rotation_xyz(*tilt)
    position = distance_m * np.array([-0.3, 0.1, 1.0])
    image = photograph(cells_of_code(*PUBLISHED["36h11", 0]), rotation, position, SIZE_M)
    (found,) = tag_poses.detect(image, CAMERA, NO_DISTORTION, "36h11", SIZE_M)
    assert found.id == 0
    error_m = np.linalg.norm(np.array(found.position_m) - position)
    assert error_m < POSITION_SHARE * np.linalg.norm(position)
    assert angle_deg(found.quaternion_xyzw, rotation) < ANGLE_DEG


@pytest.mark.parametrize("turns", [-3, 0, 1, 2])
@pytest.mark.parametrize("place", [(0.0, 0.0), (-0.34, 0.2)])
@pytest.mark.parametrize("tilt", [0.0, 1e-9, 1e-4, 0.7])
def test_the_pose_is_exact_at_full_half_and_quarter_turns(
    turns: int, place: tuple[float, float], tilt: float
) -> None:
    rotation = rotation_xyz(0, tilt, 0) @ rotation_xyz(0, 0, turns * np.pi / 2)
    position = np.array([*place, 1.0])
    corners = project_square(rotation, position)
    found_m, quaternion = tag_poses.pose(corners, CAMERA, NO_DISTORTION, SIZE_M)
    assert found_m == pytest.approx(position, abs=1e-5)
    assert angle_deg(quaternion, rotation) < 0.01


@pytest.mark.parametrize("turns", range(4))
def test_the_orientation_of_opencvs_dictionary_is_found_out(turns: int) -> None:
    printed = cells_of_code(*PUBLISHED["36h11", 0])[1:-1, 1:-1].astype(np.uint8)
    held = np.ascontiguousarray(np.rot90(printed, turns))
    dictionary = cv2.aruco.Dictionary(cv2.aruco.Dictionary.getByteListFromBits(held), 6, 5)
    assert tag_poses.quarter_turns(dictionary, "36h11") == turns
