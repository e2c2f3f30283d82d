"""A node that resizes images together with their camera_info."""

from __future__ import annotations

from sensor_msgs.msg import CameraInfo, Image

from r2bspec.nodes import camera, images
from r2bspec.nodes.node_tools import (
    QOS_DEPTH,
    Constraint,
    ReferenceNode,
    any_bool,
    one_of,
    positive,
)

_PIXELS = Constraint("1 or more, or -1 for the input's", lambda value: value == -1 or value >= 1)


class ResizeNode(ReferenceNode):
    """Resizes images and camera_info, with the topics of image_proc's ResizeNode.

    Subscribes to ``image/image_raw`` and ``image/camera_info``, paired by stamp; publishes
    ``resize/image_raw`` and ``resize/camera_info`` with the same headers. The size is `width` and
    `height` in pixels, or with `use_scale` that of the input times `scale_width` and
    `scale_height`. All topics are reliable and keep the last 10 messages.

    Raises:
        ValueError: the value of a parameter is not allowed.
    """

    name_by_default = "resize"

    def start(self) -> None:
        """Declare the parameters, and create publishers and subscriptions."""
        self._use_scale = self.declare(
            "use_scale",
            False,
            "scale the input instead of using width and height",
            any_bool(),
        )
        self._scale_width = self.declare(
            "scale_width", 1.0, "width of the output over that of the input", positive()
        )
        self._scale_height = self.declare(
            "scale_height",
            1.0,
            "height of the output over that of the input",
            positive(),
        )
        self._width = self.declare("width", -1, "width of the output in pixels", _PIXELS)
        self._height = self.declare("height", -1, "height of the output in pixels", _PIXELS)
        self._interpolation = self.declare(
            "interpolation",
            1,
            "0 nearest, 1 linear, 2 cubic, 3 area, 4 Lanczos over 8x8 pixels",
            one_of(0, 1, 2, 3, 4),
        )
        self._image_publisher = self.create_publisher(Image, "resize/image_raw", QOS_DEPTH)
        self._info_publisher = self.create_publisher(CameraInfo, "resize/camera_info", QOS_DEPTH)
        self.subscribe_set(
            {"image/image_raw": Image, "image/camera_info": CameraInfo}, self._on_pair
        )

    def _on_pair(self, image: Image, info: CameraInfo) -> None:
        width, height = self._output_size(image)
        resized = Image(
            header=image.header,
            data=images.resize(image, width, height, self._interpolation),
            **images.layout(image.encoding, width, height),
        )
        camera.scale(info, width / image.width, height / image.height)
        self._image_publisher.publish(resized)
        self._info_publisher.publish(info)

    def _output_size(self, image: Image) -> tuple[int, int]:
        if self._use_scale:
            return (
                max(1, round(image.width * self._scale_width)),
                max(1, round(image.height * self._scale_height)),
            )
        return (
            image.width if self._width == -1 else self._width,
            image.height if self._height == -1 else self._height,
        )
