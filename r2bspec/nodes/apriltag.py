"""A node that finds AprilTags and tells where they are."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image

from r2bspec.nodes import camera, camera_subscription, images, tag_poses
from r2bspec.nodes.declared_parameters import declare, destroy_on_value_error, greater_than, one_of


class AprilTagNode(Node):
    """Finds the AprilTags of one family in 8-bit images, with OpenCV's ArUco module.

    Reads ``image`` and ``camera_info``, paired by stamp; writes ``detections``, for each image the
    poses of its tags by their ids, under the image's header. An image without tags gives an array
    without poses. What a tag's pose means is said in `r2bspec.nodes.tag_poses`. All topics are
    reliable and keep the last 10 messages.

    Raises:
        ValueError: a parameter has a value that it may not have.
    """

    def __init__(self, node_name: str = "apriltag", **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        with destroy_on_value_error(self):
            self._start()

    def _start(self) -> None:
        self._family = declare(
            self, "family", "36h11", "family of the tags", one_of(*tag_poses.FAMILIES)
        )
        self._size_m = declare(
            self, "size", 0.162, "edge of a tag's black square in metres", greater_than(0)
        )
        self._refinement = declare(
            self,
            "corner_refinement",
            "subpix",
            "how corners are brought below one pixel",
            one_of(*tag_poses.REFINEMENTS),
        )
        self._publisher = self.create_publisher(
            PoseArray, "detections", camera_subscription.QOS_DEPTH
        )
        camera_subscription.subscribe_pair(self, "image", "camera_info", self._on_pair)

    def _on_pair(self, image: Image, info: CameraInfo) -> None:
        found = tag_poses.detect(
            images.gray(images.view(image), image.encoding),
            camera.matrix(info),
            camera.distortion(info),
            self._family,
            self._size_m,
            refinement=self._refinement,
        )
        self._publisher.publish(PoseArray(header=image.header, poses=[_pose(tag) for tag in found]))


def _pose(tag: tag_poses.Detection) -> Pose:
    x, y, z = tag.position_m
    qx, qy, qz, qw = tag.quaternion_xyzw
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))
