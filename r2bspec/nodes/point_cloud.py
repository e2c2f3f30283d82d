"""A node that computes point clouds from disparities."""

from __future__ import annotations

from array import array

from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField
from stereo_msgs.msg import DisparityImage

from r2bspec.nodes import camera, images, stereo
from r2bspec.nodes.node_tools import QOS_DEPTH, ReferenceNode

_FIELDS = tuple(
    PointField(name=name, offset=offset, datatype=PointField.FLOAT32, count=1)
    for name, offset in (("x", 0), ("y", 4), ("z", 8), ("rgb", 12))
)


class PointCloudNode(ReferenceNode):
    """Turns disparities into points, each with the colour of its pixel.

    Subscribes to ``disparity``, ``left/image_rect_color`` and ``left/camera_info``, all with the
    same stamp; publishes ``points2``, as many points as pixels, in the frame and with the header of
    the disparities. Pixels without a disparity are NaN. All topics are reliable and keep the last
    10 messages.
    """

    name_by_default = "point_cloud"

    def start(self) -> None:
        """Create publisher and subscriptions."""
        self._publisher = self.create_publisher(PointCloud2, "points2", QOS_DEPTH)
        self.subscribe_set(
            {
                "left/image_rect_color": Image,
                "left/camera_info": CameraInfo,
                "disparity": DisparityImage,
            },
            self._on_set,
        )

    def _on_set(self, image: Image, info: CameraInfo, disparity: DisparityImage) -> None:
        view = images.view(disparity.image)
        if (image.width, image.height) != (disparity.image.width, disparity.image.height):
            raise ValueError(
                f"the image has {image.width}x{image.height} pixels, "
                f"the disparity {disparity.image.width}x{disparity.image.height}"
            )
        cloud = stereo.points(
            view, camera.projection(info), disparity.f, disparity.t, disparity.min_disparity
        )
        cloud["rgb"] = stereo.colors(images.view(image), image.encoding)
        size = stereo.POINT_TYPE.itemsize
        self._publisher.publish(
            PointCloud2(
                header=disparity.header,
                height=image.height,
                width=image.width,
                fields=_FIELDS,
                is_bigendian=bool(images.NATIVE_BIGENDIAN),
                point_step=size,
                row_step=size * image.width,
                data=array("B", cloud.tobytes()),
                is_dense=False,
            )
        )
