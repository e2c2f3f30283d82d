"""Every mistake that a script can have without a word from the tool."""

import time

from launch_ros.actions import ComposableNodeContainer
from launch_ros.descriptions import ComposableNode
from ros2_benchmark import BasicPerformanceCalculator, MonitorPerformanceCalculatorsInfo
from ros2_benchmark import ROS2BenchmarkConfig, ROS2BenchmarkTest


def launch_setup(prefix, timeout):
    space = MistakenTest.generate_namespace()
    rectify = [
        ComposableNode(
            name=f'{side}Rectify', namespace=space, package='image_proc',
            plugin='image_proc::RectifyNode',
            parameters=[{'queue_size': 5, 'queue': 5}],
            remappings=[('image', 'left/image'), ('image_rect', f'{side.lower()}/image_rect'),
                        ('/camera_info', 'left/camera_info')])
        for side in ('Left', 'Right')]
    twice = ComposableNode(
        name='LeftRectify', namespace=space, package='cell_other', plugin='cell::Other')
    loader = ComposableNode(
        name='Loader', namespace=space, package='ros2_benchmark',
        plugin='ros2_benchmark::DataLoaderNode',
        remappings=[('hawk_0_left_rgb_image', 'loaded/left/image')])
    player = ComposableNode(
        name='Player', namespace=space, package='ros2_benchmark',
        plugin='ros2_benchmark::PlaybackNode',
        parameters=[{'data_formats': ['sensor_msgs/msg/Image']}],
        remappings=[('buffer/input0', 'loaded/left/image'), ('input0', 'left/image'),
                    ('buffer/input1', 'loaded/left/camera_infos'), ('input1', 'right/camera_info')])
    monitors = [
        ComposableNode(
            name=f'Monitor{number}', namespace=space, package='ros2_benchmark',
            plugin='ros2_benchmark::MonitorNode',
            parameters=[{'monitor_index': number,
                         'monitor_data_format': 'sensor_msgs/msg/Image'}],
            remappings=[('output', topic)])
        for number, topic in enumerate(['left/image_rect', 'left/image', 'left/mono'])]
    return [ComposableNodeContainer(
        name='all', namespace=space, package='rclcpp_components',
        executable='component_container_mt',
        composable_node_descriptions=[*rectify, twice, loader, player, *monitors])]


def generate_test_description():
    return MistakenTest.generate_test_description_with_nsys(launch_setup)


class MistakenTest(ROS2BenchmarkTest):
    config = ROS2BenchmarkConfig(
        benchmark_name='Mistaken',
        input_data_path='datasets/r2b_dataset/r2b_cafe',
        playback_message_buffer_size=1,
        monitor_info_list=[
            MonitorPerformanceCalculatorsInfo(
                'monitor_node0', [BasicPerformanceCalculator({'report_prefix': 'image'})]),
            MonitorPerformanceCalculatorsInfo(
                'monitor_node1', [BasicPerformanceCalculator({'report_prefix': 'image'})]),
            MonitorPerformanceCalculatorsInfo('monitor_node5', [BasicPerformanceCalculator()])])

    def pre_benchmark_hook(self):
        time.sleep(10)

    def test_benchmark(self):
        self.run_benchmark()
