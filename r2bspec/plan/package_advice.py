"""How to install a missing ROS package, as text."""

from __future__ import annotations

import os
import re

from r2bspec.plan.this_machine import distro_of_wheels, ros_distro
from r2bspec.plan.wiring.node_interface import catalogue_packages

_DEFAULT_DISTRIBUTION = "jazzy"

_ROS_MODULES = frozenset(
    {
        *("action_tutorials_interfaces", "ament_index_python", "cv_bridge"),
        *("example_interfaces", "image_geometry", "laser_geometry", "launch", "launch_ros"),
        *("message_filters", "pcl_ros", "rclpy", "ros2_numpy", "rosbag2_py"),
        *("rosidl_runtime_py", "rqt_gui_py", "sensor_msgs_py", "tf2_geometry_msgs"),
        *("tf2_kdl", "tf2_py", "tf2_ros", "tf2_sensor_msgs", "tf_transformations"),
        "vision_opencv",
    }
)
_WHEELS = frozenset(
    {
        *("action_msgs", "actionlib_msgs", "ament_index_python", "builtin_interfaces"),
        *("diagnostic_msgs", "geometry_msgs", "lifecycle_msgs", "nav_msgs", "rcl_interfaces"),
        *("rclpy", "rosgraph_msgs", "sensor_msgs", "service_msgs", "shape_msgs", "std_msgs"),
        *("std_srvs", "stereo_msgs", "test_msgs", "trajectory_msgs", "type_description_interfaces"),
        *("unique_identifier_msgs", "visualization_msgs"),
    }
)
"""The packages that nodes import and that exist as wheels of Jazzy."""
_INTERFACE_PACKAGE = re.compile(r"_(msgs|interfaces|msg|srvs)$")


def ros_distribution() -> str:
    """Return the distribution that a user installs from: that of the environment, or Jazzy."""
    distribution = ros_distro()
    return distribution if re.fullmatch(r"[a-z]+", distribution) else _DEFAULT_DISTRIBUTION


def has_wheels() -> bool:
    """Return True if ROS comes from wheels, where packages of Ubuntu have no effect."""
    return not os.environ.get("ROS_DISTRO") and bool(distro_of_wheels())


def released_package(ros_package: str) -> str:
    """Return the Ubuntu package or wheel of a released ROS package: ``ros-jazzy-image-proc``."""
    return f"ros-{ros_distribution()}-{ros_package.replace('_', '-')}"


def ros_package_advice(package: str) -> str:
    """Return how to install a ROS package: from where ROS itself is, or from a workspace."""
    known = package in catalogue_packages() or is_ros_module(package)
    released, workspace = released_package(package), "source the workspace that contains it"
    if not has_wheels():
        install = f"sudo apt install {released}"
        if known:
            return f"{install}, or {workspace}"
        return f"{workspace}; if it is a released package: {install}"
    if package in _WHEELS:
        return f"pip install {released}"
    workspace = "source a ROS 2 installation, or the workspace, that contains it"
    return f"there is no wheel of {package}: {workspace}" if known else workspace


def is_ros_module(module: str) -> bool:
    """Return True if a Python module is, by its name, that of a ROS package."""
    return module in _ROS_MODULES or _INTERFACE_PACKAGE.search(module) is not None
