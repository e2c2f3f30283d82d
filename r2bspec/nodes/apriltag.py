"""A node that detects AprilTags and their poses."""

from __future__ import annotations

from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from sensor_msgs.msg import CameraInfo, Image

from r2bspec.nodes import camera, images, tag_poses
from r2bspec.nodes.node_tools import QOS_DEPTH, ReferenceNode, one_of, positive


class AprilTagNode(ReferenceNode):
    """Detects the AprilTags of one family in 8-bit images, with OpenCV's ArUco module.

    Subscribes to ``image`` and ``camera_info``, paired by stamp; publishes ``detections``, for each
    image the poses of its tags in the order of their ids, with the header of the image. For an
    image without tags the array is empty. `r2bspec.nodes.tag_poses` defines the pose of a tag. All
    topics are reliable and keep the last 10 messages.

    Raises:
        ValueError: the value of a parameter is not allowed.
    """

    name_by_default = "apriltag"

    def start(self) -> None:
        """Declare the parameters, and create publishers and subscriptions."""
        self._family = self.declare(
            "family", "36h11", "family of the tags", one_of(*tag_poses.FAMILIES)
        )
        self._size_m = self.declare(
            "size", 0.162, "edge of a tag's black square in metres", positive()
        )
        self._publisher = self.create_publisher(PoseArray, "detections", QOS_DEPTH)
        self.subscribe_set({"image": Image, "camera_info": CameraInfo}, self._on_pair)

    def _on_pair(self, image: Image, info: CameraInfo) -> None:
        poses = tag_poses.detect(
            images.gray(images.view(image), image.encoding),
            camera.matrix(info),
            camera.distortion(info),
            self._family,
            self._size_m,
        )
        self._publisher.publish(PoseArray(header=image.header, poses=[_pose(tag) for tag in poses]))


def _pose(tag: tag_poses.Detection) -> Pose:
    x, y, z = tag.position_m
    qx, qy, qz, qw = tag.quaternion_xyzw
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))
