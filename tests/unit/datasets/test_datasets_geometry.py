"""Cameras, disparity, depth, lidar and IMU tell of one room and one motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from numpy.typing import NDArray

from data_bags import decoded, pixels, stamp_ns, truth_of
from nightly import size
from r2bspec.bags.recording import SyntheticDataset
from r2bspec.datasets import rig
from r2bspec.datasets.cameras import (
    BODY_FROM_OPTICAL,
    GRAVITY_M_S2,
    Camera,
    Lens,
    Pose,
    camera_pose,
    cosine,
    image_bounds,
    project,
    quaternion,
    sine,
    transpose,
    undistorted,
)
from r2bspec.datasets.catalogue import SEQUENCES
from r2bspec.datasets.ground_truth import read_disparity
from r2bspec.datasets.scenes import find_scene
from r2bspec.datasets.sensors import cloud_dtype, render_depth

# Disparity, depth, lidar and IMU tell of one room and one motion.


START_NS = SEQUENCES["r2b_storage"].start_ns
OPTICAL_FROM_BODY = np.array(transpose(BODY_FROM_OPTICAL))


def sampled(image: NDArray[np.float64], across: NDArray[np.float64]) -> NDArray[np.float64]:
    """Read an image at fractional columns of each row."""
    left = np.clip(np.floor(across).astype(int), 0, image.shape[1] - 2)
    share = across - left
    rows = np.arange(image.shape[0])[:, None]
    values: NDArray[np.float64] = image[rows, left] * (1 - share) + image[rows, left + 1] * share
    return values


def rectified(made: SyntheticDataset, topic: str, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """What an ideal camera would have recorded, by OpenCV; the image itself without a lens."""
    camera = truth_of(made.path).cameras[topic]
    if not camera.distortion:
        return image
    cv2 = pytest.importorskip("cv2")
    (cx, cy), focal = camera.center_px, camera.focal_px
    matrix = np.array([[focal, 0, cx], [0, focal, cy], [0, 0, 1]])
    return np.asarray(cv2.undistort(image, matrix, np.array(camera.distortion)))


@pytest.mark.parametrize("pair", ["hawk_0", "d455_1_ir"][: size(1, 2)])
def test_the_right_image_shows_the_left_one_shifted_by_the_disparity(
    storage_room: SyntheticDataset, pair: str
) -> None:
    truth = truth_of(storage_room.path).stereo[pair]
    shown = find_scene("r2b_storage")
    left_camera, right_camera = (
        next(source.camera for source in SEQUENCES["r2b_storage"].sources if source.name == topic)
        for topic in (truth.left_topic, truth.right_topic)
    )
    assert left_camera is not None
    assert right_camera is not None
    # Of the rectified images.
    left_camera, right_camera = replace(left_camera, lens=None), replace(right_camera, lens=None)
    (left_message, left), (right_message, right) = (
        decoded(storage_room.path, topic)[1] for topic in (truth.left_topic, truth.right_topic)
    )
    assert left_message.time_ns == right_message.time_ns == truth.stamps_ns[1]
    disparity = read_disparity(storage_room.path, pair, left_message.time_ns).astype(np.float64)
    assert disparity.shape == (left_camera.height, left_camera.width)

    body = shown.motion.pose((left_message.time_ns - START_NS) / 1e9)
    left_depth = render_depth(shown.room, left_camera, camera_pose(body, left_camera))
    right_depth = render_depth(shown.room, right_camera, camera_pose(body, right_camera))
    assert np.abs(disparity - truth.focal_px * truth.baseline_m / left_depth).max() < 0.005

    across = np.arange(left_camera.width)[None, :] - disparity
    # What the right camera sees there must be as far away: else something hides the point.
    seen = (across >= 0) & (
        np.abs(sampled(right_depth.astype(np.float64), across) - left_depth) < 0.01 * left_depth
    )
    assert seen.mean() > 0.8
    grey_left, grey_right = (
        np.atleast_3d(rectified(storage_room, topic, pixels(image))).mean(axis=2)
        for topic, image in ((truth.left_topic, left), (truth.right_topic, right))
    )
    difference = np.abs(grey_left - sampled(grey_right, across))[seen]
    assert np.median(difference) < 1.5
    assert np.quantile(difference, 0.99) < 12
    # A shift of a pixel would be noticed.
    wrong = np.abs(grey_left - sampled(grey_right, across - 1))[seen]
    assert np.median(wrong) > 2 * np.median(difference)


def cloud(storage_room: SyntheticDataset) -> tuple[NDArray[np.void], int]:
    ((_, message),) = decoded(storage_room.path, "/pandar_xt_32_0_lidar")
    assert [field.name for field in message.fields] == list(cloud_dtype().names or ())
    assert message.width * message.point_step == message.row_step == len(message.data)
    return message.data.view(cloud_dtype()), stamp_ns(message)


def in_world(points: NDArray[np.void]) -> NDArray[np.float64]:
    """Points of a scan in the world, each seen from where the rig was at its time; (n, 3)."""
    motion = find_scene("r2b_storage").motion
    columns = points.reshape(rig.PANDAR.columns, -1)
    world = np.empty((*columns.shape, 3))
    for number, column in enumerate(columns):
        seconds = column["timestamp"][0] - START_NS / 1e9
        sensor = motion.pose(float(seconds)).compose(
            Pose(rig.PANDAR.position_m, ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
        )
        local = np.stack([column["x"], column["y"], column["z"]], axis=1).astype(np.float64)
        world[number] = local @ np.array(sensor.rotation).T + sensor.position_m
    return world.reshape(-1, 3)


def test_lidar_points_lie_on_the_surfaces(storage_room: SyntheticDataset) -> None:
    points, _ = cloud(storage_room)
    assert len(points) == 32 * 2000
    world = in_world(points)
    room = find_scene("r2b_storage").room

    low, high = np.array(room.shell.low_m), np.array(room.shell.high_m)
    assert (world > low - 1e-4).all()
    assert (world < high + 1e-4).all()
    off = np.minimum(np.abs(world - low), np.abs(world - high)).min(axis=1)
    for box in room.boxes:
        beyond = np.maximum(np.array(box.low_m) - world, world - np.array(box.high_m)).max(axis=1)
        assert (beyond > -1e-4).all()
        off = np.minimum(off, np.abs(beyond))
    assert off.max() < 1e-4


def test_lidar_rings_and_times_are_those_of_the_sensor(storage_room: SyntheticDataset) -> None:
    points, stamp = cloud(storage_room)
    elevation = np.degrees(np.arctan2(points["z"], np.hypot(points["x"], points["y"])))
    assert np.abs(elevation - (15.0 - points["ring"])).max() < 1e-3
    offsets = points["timestamp"] - stamp / 1e9
    assert abs(offsets[0]) < 1e-6
    assert (np.diff(offsets) >= 0).all()
    assert 0.0999 < offsets[-1] < 0.1
    assert points["intensity"].min() >= 0
    assert points["intensity"].max() <= 255


def test_imu_agrees_with_the_cameras_motion(storage_room: SyntheticDataset) -> None:
    """The camera's own path, differentiated numerically, gives what the IMU measured."""
    motion, step = find_scene("r2b_storage").motion, 1e-3

    def camera_at(seconds: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        pose = camera_pose(motion.pose(seconds), rig.COLOUR)
        return np.array(pose.position_m), np.array(pose.rotation)

    lever = -OPTICAL_FROM_BODY @ np.array(rig.COLOUR.position_m)
    readings = decoded(storage_room.path, "/d455_1_imu")
    assert len(readings) == 10
    for message, reading in readings:
        seconds = (message.time_ns - START_NS) / 1e9
        turns = [camera_at(seconds + shift)[1] for shift in (-step, 0.0, step)]
        spin = turns[1].T @ (turns[2] - turns[0]) / (2 * step)
        rate = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        measured = reading.angular_velocity
        assert np.abs(rate - [measured.x, measured.y, measured.z]).max() < 1e-5

        imu = [
            position + turn @ lever
            for position, turn in (camera_at(seconds + shift) for shift in (-step, 0.0, step))
        ]
        acceleration = (imu[0] - 2 * imu[1] + imu[2]) / step**2
        force = turns[1].T @ (acceleration - np.array([0.0, 0.0, -GRAVITY_M_S2]))
        measured = reading.linear_acceleration
        assert np.abs(force - [measured.x, measured.y, measured.z]).max() < 1e-4
        assert reading.orientation_covariance[0] == -1


def test_the_truth_tells_the_bodys_path(storage_room: SyntheticDataset) -> None:
    truth = truth_of(storage_room.path)
    motion = find_scene("r2b_storage").motion
    assert [pose.stamp_ns for pose in truth.body] == sorted(
        {
            message.time_ns
            for topic in ("/d455_1_imu", "/d455_1_depth", "/pandar_xt_32_0_lidar")
            for message, _ in decoded(storage_room.path, topic)
        }
    )
    for stamped in truth.body:
        pose = motion.pose((stamped.stamp_ns - START_NS) / 1e9)
        assert stamped.position_m == pose.position_m
        assert stamped.orientation_xyzw == quaternion(pose.rotation)
        assert math.hypot(*stamped.orientation_xyzw) == pytest.approx(1.0)


@pytest.mark.parametrize("name", sorted(SEQUENCES))
def test_every_place_can_be_seen(name: str) -> None:
    """The rig stays inside the room, clear of what stands there, and stereo can follow."""
    shown = find_scene(name)
    nearest = math.inf
    for second in range(0, 10, 2):
        body = shown.motion.pose(second)
        for low, value, high in zip(
            shown.room.shell.low_m, body.position_m, shown.room.shell.high_m, strict=True
        ):
            assert low + 0.3 < value < high - 0.3
        depth = render_depth(shown.room, rig.LEFT_IR, camera_pose(body, rig.LEFT_IR))
        nearest = min(nearest, float(depth.min()))
        assert depth.max() > 2
    assert nearest > 0.8


# The lenses of the rig distort as OpenCV's model does; sines are the same on every machine.


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
