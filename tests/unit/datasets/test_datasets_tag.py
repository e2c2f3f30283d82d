"""The tag is where the ground truth says, as any detector can see."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data_bags import decoded, pixels, stamp_ns, truth_of
from r2bspec.bags.recording import SyntheticDataset
from r2bspec.datasets.cameras import BODY_FROM_OPTICAL, Lens, Pose
from r2bspec.datasets.ground_truth import CameraTruth, TagSighting
from r2bspec.datasets.scenes import board_cells, find_scene, tag_pose

IMAGE_TOPICS = [
    "/d455_1_rgb_image",
    "/d455_1_left_ir_image",
    "/d455_1_right_ir_image",
    "/hawk_0_left_rgb_image",
    "/hawk_0_right_rgb_image",
]
TAG_SIZE_M = 0.162


def grey(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return image if image.ndim == 2 else image[:, :, 1].copy()


def sightings(made: SyntheticDataset, topic: str) -> tuple[TagSighting, ...]:
    tag = truth_of(made.path).tag
    assert tag is not None
    assert (tag.family, tag.id, tag.size_m) == ("36h11", 3, TAG_SIZE_M)
    return tag.sightings[topic]


def test_a_tag_seen_frontally_is_not_rotated() -> None:
    tag = find_scene("r2b_storage").tag
    assert tag is not None
    x, y, z = tag.center_m
    seen = tag_pose(tag, Pose((x - 2.0, y, z), BODY_FROM_OPTICAL))
    assert np.array_equal(seen.rotation, np.eye(3))
    assert seen.position_m == pytest.approx((0.0, 0.0, 2.0))


def half_turns() -> int:
    """By how many half turns OpenCV's tag differs: up to 5.0 its dictionary is upside down."""
    cv2 = pytest.importorskip("cv2")
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    marker = cv2.aruco.generateImageMarker(family, 3, 8, borderBits=1) > 128
    printed = board_cells()[2:-2, 2:-2] > 128
    return next(turns for turns in range(3) if np.array_equal(np.rot90(marker, 2 * turns), printed))


@pytest.mark.parametrize("topic", IMAGE_TOPICS)
def test_sightings_are_consistent(storage_room: SyntheticDataset, topic: str) -> None:
    camera = truth_of(storage_room.path).cameras[topic]
    frames = decoded(storage_room.path, topic)
    seen = sightings(storage_room, topic)
    assert [each.stamp_ns for each in seen] == [message.time_ns for message, _ in frames]
    for each in seen:
        assert each.visible
        corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * TAG_SIZE_M / 2
        points = corners @ Rotation.from_quat(each.orientation_xyzw).as_matrix().T + each.position_m
        projected = shown(camera, points[:, :2] / points[:, 2:])
        assert np.abs(projected - each.corners_px).max() < 1e-6


def shown(camera: CameraTruth, ideal: NDArray[np.float64]) -> NDArray[np.float64]:
    """The pixels at which a camera shows points of the plane one focal length away; (n, 2)."""
    if camera.distortion:
        lens = Lens(*camera.distortion)
        ideal = np.array([lens.distort(float(x), float(y)) for x, y in ideal])
    places: NDArray[np.float64] = ideal * camera.focal_px + np.array(camera.center_px)
    return places


def detect(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Corners of the one tag that OpenCV finds, from the top left as it is printed, (4, 2)."""
    cv2 = pytest.importorskip("cv2")
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    corners, ids, _ = cv2.aruco.ArucoDetector(family, parameters).detectMarkers(image)
    assert ids is not None
    assert ids.ravel().tolist() == [3]
    return np.roll(np.asarray(corners[0][0], np.float64), 2 * half_turns(), axis=0)


@pytest.mark.parametrize("topic", IMAGE_TOPICS)
def test_opencv_finds_its_corners(storage_room: SyntheticDataset, topic: str) -> None:
    frames = decoded(storage_room.path, topic)
    for (_, message), seen in zip(frames, sightings(storage_room, topic), strict=True):
        assert np.abs(detect(grey(pixels(message))) - seen.corners_px).max() < 0.5


def test_camera_info_agrees_with_the_image(storage_room: SyntheticDataset) -> None:
    truth = truth_of(storage_room.path)
    for topic in IMAGE_TOPICS:
        camera = truth.cameras[topic]
        infos = decoded(storage_room.path, topic.replace("_image", "_camera_info"))
        for (_, image), (stored, info) in zip(
            decoded(storage_room.path, topic), infos, strict=True
        ):
            assert stamp_ns(image) == stamp_ns(info) == stored.time_ns
            assert image.header.frame_id == info.header.frame_id == camera.frame_id
            assert (image.width, image.height) == (info.width, info.height)
            assert image.step == image.width * (3 if image.encoding == "rgb8" else 1)
            assert info.distortion_model == "plumb_bob"
            assert tuple(info.d) == (camera.distortion or (0.0,) * 5)
            assert bool(camera.distortion) == ("hawk" in topic)
            assert np.array_equal(info.r.reshape(3, 3), np.eye(3))
            assert np.array_equal(info.k.reshape(3, 3), info.p.reshape(3, 4)[:, :3])
            assert (info.k[0], info.k[4]) == (camera.focal_px, camera.focal_px)
            assert (info.k[2], info.k[5]) == camera.center_px
            assert info.p[3] == -camera.focal_px * _baseline_m(truth.cameras, topic)


def _baseline_m(cameras: dict[str, Any], topic: str) -> float:
    """Distance to the left camera of the pair."""
    if "_right_" not in topic:
        return 0.0
    left = cameras[topic.replace("_right_", "_left_")].position_in_body_m
    return float(left[1] - cameras[topic].position_in_body_m[1])
