"""A node that rectifies images."""

from __future__ import annotations

from sensor_msgs.msg import CameraInfo, Image

from r2bspec.nodes import camera, images
from r2bspec.nodes.node_tools import QOS_DEPTH, ReferenceNode


class RectifyNode(ReferenceNode):
    """Removes the distortion of a camera's images, and rotates those of a stereo pair into rows.

    Subscribes to ``image`` and ``camera_info``, paired by stamp; publishes ``image_rect`` and
    ``camera_info_rect``, the camera of the rectified image, with the same headers. All topics are
    reliable and keep the last 10 messages.
    """

    name_by_default = "rectify"

    def start(self) -> None:
        """Create publishers and subscriptions."""
        self._image_publisher = self.create_publisher(Image, "image_rect", QOS_DEPTH)
        self._info_publisher = self.create_publisher(CameraInfo, "camera_info_rect", QOS_DEPTH)
        self.subscribe_set({"image": Image, "camera_info": CameraInfo}, self._on_pair)

    def _on_pair(self, image: Image, info: CameraInfo) -> None:
        memory, target = images.allocate(image.encoding, image.height, image.width)
        camera.rectify(images.view(image), info, target)
        camera.rectified(info, image.width, image.height)
        self._image_publisher.publish(
            Image(
                header=image.header,
                data=memory,
                **images.layout(image.encoding, image.width, image.height),
            )
        )
        self._info_publisher.publish(info)
