"""A source for `live.r2b.yaml`: a camera that is not there, at 20 images a second."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import Image

WIDTH, HEIGHT = 320, 240


class Camera(Node):  # type: ignore[misc]
    """Publishes gray images, stamped with the time at which they are."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("camera", **kwargs)
        self._images = self.create_publisher(Image, "image", 10)
        self._pixels = bytes(WIDTH * HEIGHT)
        self.create_timer(0.05, self._publish)

    def _publish(self) -> None:
        message = Image(height=HEIGHT, width=WIDTH, encoding="mono8", step=WIDTH)
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = "camera"
        message.data = self._pixels
        self._images.publish(message)
