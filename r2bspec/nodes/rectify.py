"""A node that rectifies images."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image

from r2bspec.nodes import camera, images, node_tools, rectification
from r2bspec.nodes.node_tools import declare, destroy_on_value_error, one_of


class RectifyNode(Node):
    """Removes the distortion of a camera's images, and rotates those of a stereo pair into rows.

    Subscribes to ``image`` and ``camera_info``, paired by stamp; publishes ``image_rect`` and
    ``camera_info_rect``, the camera of the rectified image, with the same headers. All topics are
    reliable and keep the last 10 messages. `interpolation` has the numbers of image_proc.

    Raises:
        ValueError: the value of a parameter is not allowed.
    """

    def __init__(self, node_name: str = "rectify", **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        with destroy_on_value_error(self):
            self._start()

    def _start(self) -> None:
        self._interpolation = declare(
            self,
            "interpolation",
            1,
            "0 nearest, 1 linear, 2 cubic, 4 Lanczos over 8x8 pixels",
            one_of(*rectification.INTERPOLATIONS),
        )
        self._image_publisher = self.create_publisher(Image, "image_rect", node_tools.QOS_DEPTH)
        self._info_publisher = self.create_publisher(
            CameraInfo, "camera_info_rect", node_tools.QOS_DEPTH
        )
        node_tools.subscribe_pair(self, "image", "camera_info", self._on_pair)

    def _on_pair(self, image: Image, info: CameraInfo) -> None:
        memory, target = images.allocate(image.encoding, image.height, image.width)
        rectification.rectify(images.view(image), info, target, self._interpolation)
        camera.rectified(info, image.width, image.height)
        self._image_publisher.publish(
            Image(
                header=image.header,
                height=image.height,
                width=image.width,
                encoding=image.encoding,
                is_bigendian=images.NATIVE_BIGENDIAN,
                step=image.width * images.pixel_format(image.encoding).pixel_bytes,
                data=memory,
            )
        )
        self._info_publisher.publish(info)
