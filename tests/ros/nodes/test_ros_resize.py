"""The resize node, with real messages."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("cv2")

from node_graph import NodeGraph, header, image, node_graph
from rcl_interfaces.msg import Log
from sensor_msgs.msg import CameraInfo, Image

from r2bspec.nodes import ResizeNode


def picture(step: int, width: int = 64, height: int = 40) -> Image:
    pixels = np.full((height, width, 3), (step, 2 * step, 3 * step), np.uint8)
    return image(step, pixels, "rgb8")


def camera_info(step: int, width: int = 64, height: int = 40) -> CameraInfo:
    return CameraInfo(
        header=header(step),
        width=width,
        height=height,
        distortion_model="plumb_bob",
        d=[0.1, 0.0, 0.0, 0.0, 0.0],
        k=[50.0, 0.0, 31.5, 0.0, 50.0, 19.5, 0.0, 0.0, 1.0],
        p=[50.0, 0.0, 31.5, -5.0, 0.0, 50.0, 19.5, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


class Resizing:
    """A resize node, what goes in and what has come out."""

    def __init__(self, graph: NodeGraph, **parameters: Any) -> None:
        graph.add(ResizeNode, parameters=parameters)
        self._graph = graph
        self.images = graph.listen(Image, "resize/image_raw")
        self.infos = graph.listen(CameraInfo, "resize/camera_info")
        self._image_in = graph.writer(Image, "image/image_raw")
        self._info_in = graph.writer(CameraInfo, "image/camera_info")

    def send(self, *messages: Any) -> None:
        for message in messages:
            (self._image_in if isinstance(message, Image) else self._info_in).publish(message)

    def wait(self, count: int) -> None:
        self._graph.spin_until(lambda: min(len(self.images), len(self.infos)) >= count)

    def steps(self) -> list[int]:
        assert [one.header for one in self.images] == [info.header for info in self.infos]
        return [int(one.header.stamp.nanosec) for one in self.images]


def test_image_and_camera_are_resized_under_their_header() -> None:
    with node_graph() as graph:
        node = Resizing(graph, width=32, height=30)
        node.send(picture(7), camera_info(7))
        node.wait(1)
    (resized,), (info,) = node.images, node.infos
    assert resized.header == header(7)
    assert info.header == header(7)
    assert (resized.width, resized.height, resized.step) == (32, 30, 96)
    assert (resized.encoding, resized.is_bigendian) == ("rgb8", 0)
    assert bytes(resized.data) == bytes([7, 14, 21]) * (32 * 30)
    assert (info.width, info.height) == (32, 30)
    # The middle of the image stays the middle.
    assert info.k.tolist() == pytest.approx([25, 0, 15.5, 0, 37.5, 14.5, 0, 0, 1])
    assert info.p.tolist() == pytest.approx([25, 0, 15.5, -2.5, 0, 37.5, 14.5, 0, 0, 0, 1, 0])
    assert info.d.tolist() == [0.1, 0.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("parameters", "size"),
    [
        ({}, (64, 40)),
        ({"width": 16}, (16, 40)),
        ({"use_scale": True, "scale_width": 0.5, "scale_height": 2.0, "width": 9}, (32, 80)),
        ({"use_scale": True, "scale_width": 0.001}, (1, 40)),
    ],
)
def test_the_size_is_given_or_the_inputs_or_scaled(
    parameters: dict[str, Any], size: tuple[int, int]
) -> None:
    with node_graph() as graph:
        node = Resizing(graph, **parameters)
        node.send(picture(1), camera_info(1))
        node.wait(1)
    assert (node.images[0].width, node.images[0].height) == size


def test_late_lost_and_disordered_camera_infos_find_their_images() -> None:
    with node_graph() as graph:
        node = Resizing(graph, width=8, height=8)
        node.send(picture(1), picture(2), picture(3), picture(4))
        # The third is lost, the second comes before the first.
        node.send(camera_info(2), camera_info(1), camera_info(4), camera_info(5), picture(5))
        node.wait(4)
    assert sorted(node.steps()) == [1, 2, 4, 5]
    colours = {step: one.data[0] for step, one in zip(node.steps(), node.images, strict=True)}
    assert colours == {1: 1, 2: 2, 4: 4, 5: 5}


def test_an_image_that_cannot_be_read_is_logged_and_passed_over() -> None:
    with node_graph() as graph:
        node = Resizing(graph, width=8, height=8)
        log = graph.listen(Log, "/rosout")
        broken = picture(1)
        broken.encoding = "yuv422"
        node.send(broken, camera_info(1), picture(2), camera_info(2))
        node.wait(1)
        graph.spin_until(lambda: log)
    assert node.steps() == [2]
    assert log[0].msg.startswith("message dropped: image encoding 'yuv422' is not one of mono8")


def test_images_without_camera_info_are_given_up_and_logged() -> None:
    with node_graph() as graph:
        node = Resizing(graph, width=8, height=8)
        log = graph.listen(Log, "/rosout")
        # In two parts, for the node's queues hold ten messages too.
        node.send(*(picture(step) for step in range(6)), picture(100), camera_info(100))
        node.wait(1)
        node.send(*(picture(step) for step in range(6, 11)))
        graph.spin_until(lambda: log)
        node.send(*(camera_info(step) for step in range(1, 11)))
        node.wait(11)
    assert node.steps() == [100, *range(1, 11)]
    assert log[0].msg.startswith("1 messages dropped so far, without a partner of the same stamp")
