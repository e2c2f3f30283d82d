"""The source of `live_graph.r2b.yaml`: a camera that shows an AprilTag, five images a second."""

from __future__ import annotations

from array import array
from typing import Any

import cv2
import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image

WIDTH, HEIGHT = 640, 480
FOCAL_PX = 600.0
TAG_PX = 160
PERIOD_S = 0.2


class TagCamera(Node):  # type: ignore[misc]
    """Publishes the same picture of a tag, stamped with the time at which it is."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("camera", **kwargs)
        self._images = self.create_publisher(Image, "image", 10)
        self._infos = self.create_publisher(CameraInfo, "camera_info", 10)
        family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        picture = np.full((HEIGHT, WIDTH), 200, np.uint8)
        top, left = (HEIGHT - TAG_PX) // 2, (WIDTH - TAG_PX) // 2
        tag = cv2.aruco.generateImageMarker(family, 3, TAG_PX)
        picture[top : top + TAG_PX, left : left + TAG_PX] = tag
        self._pixels = array("B", picture.tobytes())
        self.create_timer(PERIOD_S, self._publish)

    def _publish(self) -> None:
        image = Image(height=HEIGHT, width=WIDTH, encoding="mono8", step=WIDTH, data=self._pixels)
        image.header.stamp = self.get_clock().now().to_msg()
        image.header.frame_id = "camera"
        cx, cy = (WIDTH - 1) / 2, (HEIGHT - 1) / 2
        info = CameraInfo(header=image.header, height=HEIGHT, width=WIDTH)
        info.distortion_model, info.d = "plumb_bob", [0.0] * 5
        info.k = [FOCAL_PX, 0.0, cx, 0.0, FOCAL_PX, cy, 0.0, 0.0, 1.0]
        info.p = [FOCAL_PX, 0.0, cx, 0.0, 0.0, FOCAL_PX, cy, 0.0, 0.0, 0.0, 1.0, 0.0]
        self._infos.publish(info)
        self._images.publish(image)
