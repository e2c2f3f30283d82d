"""A node that finds the disparities of a stereo camera."""

from __future__ import annotations

from array import array

from sensor_msgs.msg import CameraInfo, Image, RegionOfInterest
from stereo_msgs.msg import DisparityImage

from r2bspec.nodes import camera, images, node_tools, stereo

_ODD = node_tools.Constraint("odd, 5 or more", lambda value: value >= 5 and value % 2 == 1)
_SIXTEENS = node_tools.Constraint("a multiple of 16", lambda value: value > 0 and value % 16 == 0)


class DisparityNode(node_tools.ReferenceNode):
    """Finds, for each pixel of a rectified left image, where the right image shows the same point.

    Subscribes to ``left/image_rect`` and ``right/image_rect`` with their ``left/camera_info`` and
    ``right/camera_info``, all four with the same stamp; publishes ``disparity`` with the header of
    the left image. Of the cameras only the projection `p` is used. Images may be in colour. All
    topics are reliable and keep the last 10 messages. The parameters have the names and the other
    settings the defaults of stereo_image_proc.

    Raises:
        ValueError: the value of a parameter is not allowed.
    """

    name_by_default = "disparity"

    def start(self) -> None:
        """Declare the parameters, and create publishers and subscriptions."""
        self._window_px = self.declare(
            "correlation_window_size", 15, "edge of the compared square, pixels", _ODD
        )
        self._range_px = self.declare(
            "disparity_range", 64, "how many disparities are tried", _SIXTEENS
        )
        self._matcher = stereo.make_matcher(self._range_px, self._window_px)
        self._publisher = self.create_publisher(DisparityImage, "disparity", node_tools.QOS_DEPTH)
        self.subscribe_set(
            {
                "left/image_rect": Image,
                "left/camera_info": CameraInfo,
                "right/image_rect": Image,
                "right/camera_info": CameraInfo,
            },
            self._on_set,
        )

    def _on_set(
        self, left: Image, left_info: CameraInfo, right: Image, right_info: CameraInfo
    ) -> None:
        left_camera, right_camera = camera.projection(left_info), camera.projection(right_info)
        baseline_m = -right_camera[0, 3] / right_camera[0, 0]
        if baseline_m <= 0:
            raise ValueError("right/camera_info has no baseline: p[3] must be negative")
        offset_px = float(left_camera[0, 2] - right_camera[0, 2])
        disparities = stereo.disparity(
            self._matcher,
            images.gray(images.view(left), left.encoding),
            images.gray(images.view(right), right.encoding),
            offset_px,
        )
        window = stereo.valid_window(self._range_px, self._window_px, left.width, left.height)
        self._publisher.publish(
            DisparityImage(
                header=left.header,
                image=Image(
                    header=left.header,
                    data=array("B", disparities.tobytes()),
                    **images.layout("32FC1", left.width, left.height),
                ),
                f=float(left_camera[0, 0]),
                t=float(baseline_m),
                valid_window=RegionOfInterest(
                    x_offset=window.x, y_offset=window.y, width=window.width, height=window.height
                ),
                min_disparity=-offset_px,
                max_disparity=self._range_px - 1 - offset_px,
                delta_d=stereo.DISPARITY_STEP_PX,
            )
        )
