"""A node that finds the disparities of a stereo camera."""

from __future__ import annotations

from array import array

from sensor_msgs.msg import CameraInfo, Image, RegionOfInterest
from stereo_msgs.msg import DisparityImage

from r2bspec.nodes import camera, images, node_tools, stereo

_ODD = node_tools.Constraint("odd, 5 or more", lambda value: value >= 5 and value % 2 == 1)
_SIXTEENS = node_tools.Constraint("a multiple of 16", lambda value: value > 0 and value % 16 == 0)
_ANY = node_tools.Constraint("any", lambda _: True)


class DisparityNode(node_tools.ReferenceNode):
    """Finds, for each pixel of a rectified left image, where the right image shows the same point.

    Subscribes to ``left/image_rect`` and ``right/image_rect`` with their ``left/camera_info`` and
    ``right/camera_info``, all four with the same stamp; publishes ``disparity`` with the header of
    the left image. Of the cameras only the projection `p` is used. Images may be in colour. All
    topics are reliable and keep the last 10 messages. Parameters are those of stereo_image_proc.

    Raises:
        ValueError: the value of a parameter is not allowed.
    """

    name_by_default = "disparity"

    def start(self) -> None:
        """Declare the parameters, and create publishers and subscriptions."""
        self._matching = self._declared()
        self._matcher = stereo.make_matcher(self._matching)
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

    def _declared(self) -> stereo.MatcherParameters:
        return stereo.MatcherParameters(
            algorithm=self.declare(
                "stereo_algorithm",
                0,
                "0 block matching, 1 semi-global block matching",
                node_tools.one_of(stereo.BLOCK_MATCHING, stereo.SEMI_GLOBAL),
            ),
            window_px=self.declare(
                "correlation_window_size", 15, "edge of the compared square, pixels", _ODD
            ),
            min_disparity_px=self.declare(
                "min_disparity", 0, "smallest disparity that is tried, pixels", _ANY
            ),
            range_px=self.declare(
                "disparity_range", 64, "how many disparities are tried", _SIXTEENS
            ),
            prefilter_cap=self.declare(
                "prefilter_cap",
                31,
                "limit of the filtered brightness",
                node_tools.Constraint("1 to 63", lambda value: 1 <= value <= 63),
            ),
            texture_threshold=self.declare(
                "texture_threshold", 10, "least texture of a window", node_tools.at_least(0)
            ),
            uniqueness_percent=self.declare(
                "uniqueness_ratio",
                15.0,
                "by how many percent the best match must be better than the second",
                node_tools.at_least(0),
            ),
            speckle_px=self.declare(
                "speckle_size", 100, "patches of fewer pixels are left out", node_tools.at_least(0)
            ),
            speckle_range_px=self.declare(
                "speckle_range",
                4,
                "largest difference inside a patch, pixels",
                node_tools.at_least(0),
            ),
            small_step_cost=self.declare(
                "P1", 200, "cost of a difference of 1 to a neighbour", node_tools.positive()
            ),
            large_step_cost=self.declare(
                "P2", 400, "cost of a larger difference to a neighbour", node_tools.positive()
            ),
        )

    def _on_set(
        self, left: Image, left_info: CameraInfo, right: Image, right_info: CameraInfo
    ) -> None:
        left_camera, right_camera = camera.projection(left_info), camera.projection(right_info)
        baseline_m = -right_camera[0, 3] / right_camera[0, 0]
        if baseline_m <= 0:
            raise ValueError("right/camera_info has no baseline: p[3] must be negative")
        offset_px = float(left_camera[0, 2] - right_camera[0, 2])
        found = stereo.disparity(
            self._matcher,
            images.gray(images.view(left), left.encoding),
            images.gray(images.view(right), right.encoding),
            offset_px,
        )
        tried = self._matching
        window = stereo.valid_window(tried, left.width, left.height)
        self._publisher.publish(
            DisparityImage(
                header=left.header,
                image=Image(
                    header=left.header,
                    data=array("B", found.tobytes()),
                    **images.layout("32FC1", left.width, left.height),
                ),
                f=float(left_camera[0, 0]),
                t=float(baseline_m),
                valid_window=RegionOfInterest(
                    x_offset=window.x, y_offset=window.y, width=window.width, height=window.height
                ),
                min_disparity=tried.min_disparity_px - offset_px,
                max_disparity=tried.min_disparity_px + tried.range_px - 1 - offset_px,
                delta_d=stereo.DISPARITY_STEP_PX,
            )
        )
