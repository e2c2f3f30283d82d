"""The nodes of the stereo graph, with real messages: from two raw cameras to a point cloud."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("cv2")

from node_graph import NodeGraph, header, image, node_graph
from rcl_interfaces.msg import Log
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from stereo_msgs.msg import DisparityImage

from r2bspec.nodes import DisparityNode, PointCloudNode, RectifyNode
from r2bspec.nodes.stereo import POINT_TYPE

WIDTH, HEIGHT = 320, 120
FOCAL_PX, BASELINE_M, DISPARITY_PX = 200.0, 0.1, 20
INPUTS = {
    "left/image_rect": Image,
    "left/camera_info": CameraInfo,
    "right/image_rect": Image,
    "right/camera_info": CameraInfo,
}


def wall(offset: int) -> np.ndarray[Any, Any]:
    """A wall, seen by a camera that is further right by this many pixels."""
    cells = np.random.default_rng(1).integers(20, 235, (HEIGHT // 2, WIDTH), np.uint8)
    whole = np.repeat(np.repeat(cells, 2, axis=0), 3, axis=1)
    return np.ascontiguousarray(whole[:, offset : offset + WIDTH])


def camera_info(step: int, *, right: bool = False, d: tuple[float, ...] = (0.0,) * 5) -> CameraInfo:
    shift = -FOCAL_PX * BASELINE_M if right else 0.0
    cx, cy = WIDTH / 2, HEIGHT / 2
    return CameraInfo(
        header=header(step),
        width=WIDTH,
        height=HEIGHT,
        distortion_model="plumb_bob",
        d=d,
        k=[FOCAL_PX, 0.0, cx, 0.0, FOCAL_PX, cy, 0.0, 0.0, 1.0],
        r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p=[FOCAL_PX, 0.0, cx, shift, 0.0, FOCAL_PX, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


def stereo(step: int) -> list[Any]:
    left, right = (image(step, wall(64 + at), "mono8") for at in (0, DISPARITY_PX))
    return [left, camera_info(step), right, camera_info(step, right=True)]


class StereoGraph:
    """A disparity node and a point cloud node behind it."""

    def __init__(self, graph: NodeGraph, **parameters: Any) -> None:
        graph.add(DisparityNode, parameters=parameters)
        graph.add(PointCloudNode)
        self._graph = graph
        self.disparities = graph.listen(DisparityImage, "disparity")
        self.clouds = graph.listen(PointCloud2, "points2")
        self._inputs = [graph.writer(kind, topic) for topic, kind in INPUTS.items()]
        self._color = graph.writer(Image, "left/image_rect_color")
        # Both nodes subscribe to the left camera.
        info = self._inputs[1]
        graph.spin_until(lambda: info.get_subscription_count() == 2)

    def send(self, messages: list[Any]) -> None:
        for publisher, message in zip(self._inputs, messages, strict=True):
            publisher.publish(message)
        self._color.publish(messages[0])


def test_a_wall_becomes_points_at_its_distance() -> None:
    with node_graph() as graph:
        nodes = StereoGraph(graph, disparity_range=48)
        nodes.send(stereo(7))
        graph.spin_until(lambda: nodes.clouds)
    (disparity,), (cloud,) = nodes.disparities, nodes.clouds
    assert disparity.header == disparity.image.header == cloud.header == header(7)
    assert disparity.f == FOCAL_PX
    assert disparity.t == pytest.approx(BASELINE_M)
    assert (disparity.min_disparity, disparity.max_disparity) == (0.0, 47.0)
    found = np.frombuffer(disparity.image.data, np.float32).reshape(HEIGHT, WIDTH)
    window = disparity.valid_window
    rows = slice(window.y_offset, window.y_offset + window.height)
    columns = slice(window.x_offset, window.x_offset + window.width)
    # Beyond the right edge of the right image there is nothing to compare with.
    inside = found[rows, columns]
    assert (np.abs(inside - DISPARITY_PX) <= 1).mean() > 0.95

    assert (cloud.width, cloud.height, cloud.point_step) == (WIDTH, HEIGHT, 16)
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "rgb"]
    points = np.frombuffer(cloud.data, POINT_TYPE).reshape(HEIGHT, WIDTH)
    depth = points["z"][rows, columns]
    assert np.nanmedian(depth) == pytest.approx(FOCAL_PX * BASELINE_M / DISPARITY_PX, rel=0.02)
    assert np.isnan(points["z"]).sum() == (found < 0).sum() + (found == 0).sum()
    gray = np.frombuffer(stereo(7)[0].data, np.uint8).reshape(HEIGHT, WIDTH)
    assert np.array_equal(points["rgb"] & 0xFF, gray)


def test_a_set_is_matched_by_stamp_and_a_cameras_loss_loses_that_set_alone() -> None:
    with node_graph() as graph:
        nodes = StereoGraph(graph)
        first, second = stereo(1), stereo(2)
        # The right image of the first set is lost; what belongs to the second comes mixed with it.
        inputs = nodes._inputs
        inputs[0].publish(first[0])
        inputs[1].publish(first[1])
        inputs[3].publish(first[3])
        nodes.send(second)
        graph.spin_until(lambda: nodes.disparities)
        nodes.send(stereo(3))
        graph.spin_until(lambda: len(nodes.disparities) == 2)
    assert [disparity.header.stamp.nanosec for disparity in nodes.disparities] == [2, 3]


def test_a_camera_without_a_baseline_is_named_and_the_node_goes_on() -> None:
    with node_graph() as graph:
        nodes = StereoGraph(graph)
        said = graph.listen(Log, "/rosout")
        broken = stereo(1)
        broken[3] = camera_info(1)
        nodes.send(broken)
        graph.spin_until(lambda: any("no baseline" in each.msg for each in said))
        nodes.send(stereo(2))
        graph.spin_until(lambda: nodes.disparities)
    assert [disparity.header.stamp.nanosec for disparity in nodes.disparities] == [2]


def test_a_distorted_line_becomes_straight() -> None:
    """A lens bends a line that does not pass the centre; the node's camera_info has no lens."""
    lens = (-0.3, 0.05, 0.0, 0.0, 0.0)
    with node_graph() as graph:
        graph.add(RectifyNode)
        rectified = graph.listen(Image, "image_rect")
        infos = graph.listen(CameraInfo, "camera_info_rect")
        image_in, info_in = graph.writer(Image, "image"), graph.writer(CameraInfo, "camera_info")
        image_in.publish(image(3, _bent_line(lens), "mono8"))
        info_in.publish(camera_info(3, d=lens))
        graph.spin_until(lambda: rectified and infos)
    (shown,), (info,) = rectified, infos
    assert shown.header == info.header == header(3)
    pixels = np.frombuffer(shown.data, np.uint8).reshape(HEIGHT, WIDTH).astype(float)
    rows = (pixels * np.arange(HEIGHT)[:, None]).sum(axis=0) / pixels.sum(axis=0)
    assert np.ptp(rows[20:-20]) < 0.5
    assert not np.any(info.d)
    bent = _bent_line(lens).astype(float)[:, 20:-20]
    assert np.ptp((bent * np.arange(HEIGHT)[:, None]).sum(axis=0) / bent.sum(axis=0)) > 3


def _bent_line(lens: tuple[float, ...]) -> np.ndarray[Any, Any]:
    """What the camera shows of the line y = 0.22 in front of it, two pixels thick."""
    k1, k2 = lens[:2]
    pixels = np.zeros((HEIGHT, WIDTH))
    for x in np.linspace(-1.2, 1.2, 4000):
        square = x * x + 0.22**2
        scale = 1 + k1 * square + k2 * square**2
        u = FOCAL_PX * x * scale + WIDTH / 2
        v = FOCAL_PX * 0.22 * scale + HEIGHT / 2
        if 0 <= round(u) < WIDTH:
            top = int(np.floor(v))
            pixels[top, round(u)], pixels[top + 1, round(u)] = top + 1 - v, v - top
    return np.round(pixels * 255).astype(np.uint8)
