"""The AprilTag node, with real messages."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("cv2")

from geometry_msgs.msg import PoseArray
from node_graph import NodeGraph, header, image, node_graph
from sensor_msgs.msg import CameraInfo, Image

from r2bspec.nodes import AprilTagNode

WIDTH, HEIGHT, FOCAL_PX = 320, 240, 200.0
# Tags 0 and 1 of the family 36h11 as they are printed: the published codes, row by row.
CODES = {0: 0xD5D628584, 1: 0xD97F18B49}
CELL_PX = 8
EDGE_PX = 8 * CELL_PX


def paper(step: int, tags: dict[int, tuple[int, int]], encoding: str = "mono8") -> Image:
    """White paper with upright tags, each given by the column and row of its first pixel."""
    white = np.full((HEIGHT, WIDTH), 255, np.uint8)
    for tag_id, (column, row) in tags.items():
        bits = np.array([int(bit) for bit in f"{CODES[tag_id]:036b}"]).reshape(6, 6)
        square = np.kron(np.pad(bits, 1), np.full((CELL_PX, CELL_PX), 255)).astype(np.uint8)
        white[row : row + EDGE_PX, column : column + EDGE_PX] = square
    pixels = white if encoding == "mono8" else np.repeat(white[..., None], 3, axis=2)
    return image(step, pixels, encoding)


def camera_info(step: int, focal_px: float = FOCAL_PX) -> CameraInfo:
    k = [focal_px, 0.0, 159.5, 0.0, focal_px, 119.5, 0.0, 0.0, 1.0]
    return CameraInfo(header=header(step), width=WIDTH, height=HEIGHT, k=k)


class Detecting:
    """An AprilTag node, what goes in and what has come out."""

    def __init__(self, graph: NodeGraph, **parameters: Any) -> None:
        graph.add(AprilTagNode, parameters=parameters)
        self._graph = graph
        self.detections = graph.listen(PoseArray, "detections")
        self._image_in = graph.writer(Image, "image")
        self._info_in = graph.writer(CameraInfo, "camera_info")

    def send(self, *messages: Any) -> None:
        for message in messages:
            (self._image_in if isinstance(message, Image) else self._info_in).publish(message)

    def wait(self, count: int) -> None:
        self._graph.spin_until(lambda: len(self.detections) >= count)


@pytest.mark.parametrize("encoding", ["mono8", "rgb8", "bgr8"])
def test_an_upright_tag_is_found_under_the_images_header(encoding: str) -> None:
    with node_graph() as graph:
        node = Detecting(graph, size=0.32)
        node.send(paper(5, {0: (192, 88)}, encoding), camera_info(5))
        node.wait(1)
    (found,) = node.detections
    assert found.header == header(5)
    (pose,) = found.poses
    # A 0.32 m tag of 64 pixels at a focal length of 200 is 1 m away; its middle is 64 pixels right.
    place = (pose.position.x, pose.position.y, pose.position.z)
    assert place == pytest.approx((0.32, 0.0, 1.0), abs=0.01)
    turn = pose.orientation
    assert (turn.x, turn.y, turn.z, turn.w) == pytest.approx((0, 0, 0, 1), abs=0.02)


def test_poses_are_sorted_by_tag_id() -> None:
    with node_graph() as graph:
        node = Detecting(graph)
        node.send(paper(1, {1: (40, 88), 0: (200, 88)}), camera_info(1))
        node.send(paper(2, {0: (40, 88), 1: (200, 88)}), camera_info(2))
        node.wait(2)
    first, second = (detection.poses for detection in node.detections)
    assert len(first) == len(second) == 2
    assert first[0].position.x > first[1].position.x
    assert second[0].position.x < second[1].position.x


def test_an_image_without_tags_gives_an_empty_array() -> None:
    with node_graph() as graph:
        node = Detecting(graph)
        node.send(paper(9, {}), camera_info(9))
        node.wait(1)
    assert node.detections[0].header == header(9)
    assert list(node.detections[0].poses) == []


def test_an_image_waits_for_its_own_camera_info() -> None:
    with node_graph() as graph:
        node = Detecting(graph, size=0.32)
        node.send(paper(1, {0: (128, 88)}), paper(2, {0: (128, 88)}), paper(3, {0: (128, 88)}))
        # The second is lost; the others differ, and come late and in the wrong order.
        node.send(camera_info(3, 400.0), camera_info(1, 200.0))
        node.wait(2)
    distances = {
        detection.header.stamp.nanosec: detection.poses[0].position.z
        for detection in node.detections
    }
    assert distances == pytest.approx({1: 1.0, 3: 2.0}, rel=0.02)


def test_an_uncalibrated_camera_is_passed_over() -> None:
    with node_graph() as graph:
        node = Detecting(graph)
        node.send(paper(1, {0: (128, 88)}), camera_info(1, 0.0))
        node.send(paper(2, {0: (128, 88)}), camera_info(2))
        node.wait(1)
    assert [detection.header.stamp.nanosec for detection in node.detections] == [2]
