"""Formats and default topic names of packages that scripts of ros2_benchmark use often.

The topics only tell which nodes of a script are connected; they are no interfaces.
"""

from __future__ import annotations

from typing import Final

_ADAPTED: Final = {
    "nitros_camera_info": "sensor_msgs/msg/CameraInfo",
    "nitros_compressed_image": "sensor_msgs/msg/CompressedImage",
    "nitros_detection2_d_array": "vision_msgs/msg/Detection2DArray",
    "nitros_detection3_d_array": "vision_msgs/msg/Detection3DArray",
    "nitros_april_tag_detection_array": "isaac_ros_apriltag_interfaces/msg/AprilTagDetectionArray",
    "nitros_flat_scan": "isaac_ros_pointcloud_interfaces/msg/FlatScan",
    "nitros_point_cloud": "sensor_msgs/msg/PointCloud2",
    "nitros_pose_cov_stamped": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "nitros_image_bridge": "isaac_ros_nitros_bridge_interfaces/msg/NitrosBridgeImage",
    "nitros_imu": "sensor_msgs/msg/Imu",
    "nitros_odometry": "nav_msgs/msg/Odometry",
    "nitros_occupancy_grid": "nav_msgs/msg/OccupancyGrid",
}
_ADAPTED_PREFIXES: Final = {
    "nitros_image_": "sensor_msgs/msg/Image",
    "nitros_disparity_image": "stereo_msgs/msg/DisparityImage",
    "nitros_tensor_list": "isaac_ros_tensor_list_interfaces/msg/TensorList",
}

_TOPICS: Final = {
    "ImageToTensorNode": ("image", "tensor"),
    "ImageTensorNormalizeNode": ("tensor", "normalized_tensor"),
    "InterleavedToPlanarNode": ("interleaved_tensor", "planar_tensor"),
    "ReshapeNode": ("tensor", "reshaped_tensor"),
    "ResizeNode": ("image", "camera_info", "resize/image", "resize/camera_info"),
    "RectifyNode": ("image_raw", "camera_info", "image_rect", "camera_info_rect"),
    "PadNode": ("image", "padded_image"),
    "CropNode": ("image", "camera_info", "crop/image", "crop/camera_info"),
    "ImageFormatConverterNode": ("image_raw", "image"),
    "TensorRTNode": ("tensor_pub", "tensor_sub"),
    "TritonNode": ("tensor_pub", "tensor_sub"),
    "UNetDecoderNode": ("tensor_sub", "unet/raw_segmentation_mask"),
    "DopeDecoderNode": ("belief_map_array", "camera_info", "dope/detections"),
    "DetectNetDecoderNode": ("tensor_sub", "detectnet/detections"),
    "CenterPoseDecoderNode": ("tensor_sub", "camera_info", "centerpose/detections"),
    "ESSDisparityNode": ("left/image_rect", "right/image_rect", "disparity"),
    "DisparityNode": ("left/image_rect", "right/image_rect", "disparity"),
    "DisparityToDepthNode": ("disparity", "depth"),
    "PointCloudNode": ("left/image_rect_color", "disparity", "points2"),
    "RtDetrPreprocessorNode": ("encoded_tensor", "tensor_pub"),
    "RtDetrDecoderNode": ("tensor_sub", "detections_output"),
}
"""By the class of the plugin, in ``nvidia::isaac_ros``."""


def ros_format(name: str) -> str:
    """The ROS type that a negotiated format is converted to; empty if it is not known."""
    if name in _ADAPTED:
        return _ADAPTED[name]
    return next((kind for start, kind in _ADAPTED_PREFIXES.items() if name.startswith(start)), "")


def default_topics(plugin: str) -> tuple[str, ...]:
    """The default topics of a plugin, as far as they are known here."""
    if not plugin.startswith("nvidia::isaac_ros::"):
        return ()
    return _TOPICS.get(plugin.rpartition("::")[2], ())
