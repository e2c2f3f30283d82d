"""Cameras, depth, scans and IMU tell of one scene and one motion."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from data_bags import decoded, pixels, stamp_ns
from r2bspec.bags.recording import SyntheticDataset
from r2bspec.datasets import rig
from r2bspec.datasets.catalogue import SEQUENCES
from r2bspec.datasets.geometry import BODY_FROM_OPTICAL, GRAVITY_M_S2, Pose
from r2bspec.datasets.rendering import camera_pose, render_depth, square_corners_px
from r2bspec.datasets.scenes import TAG_ID, find_scene
from r2bspec.datasets.sensors import cloud_dtype

START_NS = SEQUENCES["r2b_storage"].start_ns
CAMERAS = {
    source.name: source.camera
    for source in rig.ROBOT_TOPICS
    if source.type == rig.IMAGE and source.camera is not None and "depth" not in source.name
}


def sampled(image: NDArray[np.float64], across: NDArray[np.float64]) -> NDArray[np.float64]:
    """Read an image at fractional columns of each row."""
    left = np.clip(np.floor(across).astype(int), 0, image.shape[1] - 2)
    share = across - left
    rows = np.arange(image.shape[0])[:, None]
    values: NDArray[np.float64] = image[rows, left] * (1 - share) + image[rows, left + 1] * share
    return values


@pytest.mark.parametrize("prefix", ["/hawk_0_{}_rgb_image", "/d455_1_{}_ir_image"])
def test_the_right_image_shows_the_left_one_shifted_by_the_disparity(
    storage_room: SyntheticDataset, prefix: str
) -> None:
    (left_message, left), (_, right) = (
        decoded(storage_room.path, prefix.format(side))[1] for side in ("left", "right")
    )
    scene = find_scene("r2b_storage")
    body = scene.motion.pose((left_message.time_ns - START_NS) / 1e9)
    left_camera, right_camera = (CAMERAS[prefix.format(side)] for side in ("left", "right"))
    left_depth = render_depth(scene, left_camera, body)
    right_depth = render_depth(scene, right_camera, body).astype(np.float64)
    disparity = right_camera.focal_px * right_camera.baseline_m / left_depth.astype(np.float64)

    across = np.arange(left_camera.width)[None, :] - disparity
    # What the right camera sees there must be as far away: else something hides the point.
    seen = (across >= 0) & (np.abs(sampled(right_depth, across) - left_depth) < 0.01 * left_depth)
    # The tag hangs before what the depth knows of.
    corners = tag_corners(left_camera, body)
    (low_u, low_v), (high_u, high_v) = np.min(corners, axis=0), np.max(corners, axis=0)
    seen[int(low_v) - 150 : int(high_v) + 150, int(low_u) - 150 : int(high_u) + 150] = False
    assert seen.mean() > 0.7
    grey_left, grey_right = (np.atleast_3d(pixels(image)).mean(axis=2) for image in (left, right))
    difference = np.abs(grey_left - sampled(grey_right, across))[seen]
    assert np.median(difference) < 1.5
    # A shift of a pixel would be noticed.
    wrong = np.abs(grey_left - sampled(grey_right, across - 1))[seen]
    assert np.median(wrong) > 2 * np.median(difference)


def tag_corners(camera: rig.Camera, body: Pose) -> list[tuple[float, float]]:
    tag = find_scene("r2b_storage").tag
    assert tag is not None
    return square_corners_px(tag, camera, camera_pose(body, camera), tag.size_m / 2)


@pytest.mark.parametrize("topic", CAMERAS)
def test_opencv_finds_the_tag_where_it_is(storage_room: SyntheticDataset, topic: str) -> None:
    cv2 = pytest.importorskip("cv2")
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    detector = cv2.aruco.ArucoDetector(family, parameters)
    for message, image in decoded(storage_room.path, topic):
        body = find_scene("r2b_storage").motion.pose((message.time_ns - START_NS) / 1e9)
        grey = np.atleast_3d(pixels(image))[:, :, 0].copy()
        corners, ids, _ = detector.detectMarkers(grey)
        assert ids is not None
        assert ids.ravel().tolist() == [TAG_ID]
        expected = tag_corners(CAMERAS[topic], body)
        # OpenCV's dictionary is upside down up to 5.0.
        found = sorted(map(tuple, np.asarray(corners[0][0], np.float64)))
        assert np.abs(np.subtract(found, sorted(expected))).max() < 0.7


def test_camera_info_agrees_with_the_image(storage_room: SyntheticDataset) -> None:
    for topic, camera in CAMERAS.items():
        infos = decoded(storage_room.path, topic.replace("_image", "_camera_info"))
        for (_, image), (stored, info) in zip(
            decoded(storage_room.path, topic), infos, strict=True
        ):
            assert stamp_ns(image) == stamp_ns(info) == stored.time_ns
            assert image.header.frame_id == info.header.frame_id == camera.frame_id
            assert (image.width, image.height) == (info.width, info.height)
            assert image.step == image.width * (3 if image.encoding == "rgb8" else 1)
            assert not info.d.any()
            assert np.array_equal(info.k.reshape(3, 3), info.p.reshape(3, 4)[:, :3])
            assert (info.k[0], info.k[4]) == (camera.focal_px, camera.focal_px)
            assert (info.k[2], info.k[5]) == camera.center_px
            assert info.p[3] == -camera.focal_px * camera.baseline_m


def test_a_scan_has_the_rings_and_times_of_the_sensor(storage_room: SyntheticDataset) -> None:
    ((_, message),) = decoded(storage_room.path, "/pandar_xt_32_0_lidar")
    assert [field.name for field in message.fields] == list(cloud_dtype().names or ())
    assert message.width * message.point_step == message.row_step == len(message.data)
    points = message.data.view(cloud_dtype())
    assert len(points) == 32 * 2000
    elevation = np.degrees(np.arctan2(points["z"], np.hypot(points["x"], points["y"])))
    assert np.abs(elevation - (15.0 - points["ring"])).max() < 1e-3
    offsets = points["timestamp"] - stamp_ns(message) / 1e9
    assert abs(offsets[0]) < 1e-6
    assert (np.diff(offsets) >= 0).all()
    assert 0.0999 < offsets[-1] < 0.1


def test_the_imu_agrees_with_the_motion(storage_room: SyntheticDataset) -> None:
    """The path of the body, differentiated numerically, gives what the IMU measured."""
    motion, step = find_scene("r2b_storage").motion, 1e-3
    optical_from_body = np.array(BODY_FROM_OPTICAL).T
    for message, reading in decoded(storage_room.path, "/d455_1_imu"):
        seconds = (message.time_ns - START_NS) / 1e9
        before, now, after = (motion.pose(seconds + shift) for shift in (-step, 0.0, step))
        turn = np.array(now.rotation)
        spin = turn.T @ (np.array(after.rotation) - np.array(before.rotation)) / (2 * step)
        rate = optical_from_body @ [spin[2, 1], spin[0, 2], spin[1, 0]]
        measured = reading.angular_velocity
        assert np.abs(rate - [measured.x, measured.y, measured.z]).max() < 1e-5
        places = np.array([each.position_m for each in (before, now, after)])
        acceleration = (places[0] - 2 * places[1] + places[2]) / step**2
        force = optical_from_body @ turn.T @ (acceleration + np.array([0.0, 0.0, GRAVITY_M_S2]))
        measured = reading.linear_acceleration
        assert np.abs(force - [measured.x, measured.y, measured.z]).max() < 1e-4
