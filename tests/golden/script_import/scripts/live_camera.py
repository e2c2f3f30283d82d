"""The rate of a camera, which is the source of the graph."""

import os

from launch.actions import ExecuteProcess
from launch_ros.actions import ComposableNodeContainer, Node
from launch_ros.descriptions import ComposableNode
from ros2_benchmark import BenchmarkMode, ROS2BenchmarkConfig, ROS2BenchmarkTest


def launch_setup(prefix, timeout):
    space = CameraTest.generate_namespace('left_cell')
    # Its lens is number 3.
    camera = Node(
        name='camera', namespace=space, package='cell_camera', executable='camera_node',
        parameters=[{'lens': 3, 'device': os.environ['CELL_CAMERA']}],
        arguments=['--quiet'],
        remappings=[('image_raw', 'image')])
    light = ExecuteProcess(cmd=['cell_light', '--on'], name='light')
    monitor = ComposableNode(
        name='Monitor', namespace=space, package='ros2_benchmark',
        plugin='ros2_benchmark::MonitorNode',
        parameters=[{'monitor_data_format': 'sensor_msgs/msg/Image'}],
        remappings=[('output', 'image')])
    return [camera, light, ComposableNodeContainer(
        name='watch', namespace=space, package='rclcpp_components',
        executable='component_container', composable_node_descriptions=[monitor])]


def generate_test_description():
    return CameraTest.generate_test_description_with_nsys(launch_setup)


class CameraTest(ROS2BenchmarkTest):
    config = ROS2BenchmarkConfig(
        benchmark_name='Camera', benchmark_mode=BenchmarkMode.LIVE, benchmark_duration=3)

    def test_benchmark(self):
        self.run_benchmark()
