# SPDX-License-Identifier: Apache-2.0

"""
How many stereo pairs image_proc rectifies.

- Preprocessors:
    1. ShrinkLeft, ShrinkRight: make the images smaller
- Graph under Test:
    1. Rectify nodes of both sides
"""

from launch_ros.actions import ComposableNodeContainer
from launch_ros.descriptions import ComposableNode

from ros2_benchmark import ImageResolution, ROS2BenchmarkConfig, ROS2BenchmarkTest

# What the cameras of the cell deliver.
SMALL = ImageResolution.QUARTER_HD
SIDES = ['left', 'right']


def component(name, package, plugin, **others):
    return ComposableNode(
        name=name,
        namespace=StereoRectifierTest.generate_namespace(),
        package=package,
        plugin=f'{package}::{plugin}',
        **others)


def launch_setup(container_prefix, container_sigterm_timeout):
    nodes = []
    recorded = {}
    for side in SIDES:
        title = side.capitalize()
        recorded[f'hawk_0_{side}_rgb_image'] = f'loaded/{side}/image'
        recorded[f'hawk_0_{side}_rgb_camera_info'] = f'loaded/{side}/camera_info'
        nodes.append(component(
            f'Shrink{title}', 'image_proc', 'ResizeNode',
            parameters=[{'use_scale': False,
                         'width': SMALL['width'], 'height': SMALL['height']}],
            remappings=[('image/image_raw', f'loaded/{side}/image'),
                        ('resize/image_raw', f'small/{side}/image')]))
        # Bilinear, as on the robot.
        rectify = component(
            f'Rectify{title}', 'image_proc', 'RectifyNode',
            parameters=[{'interpolation': 1}],
            remappings=[('image', f'{side}/image'), ('image_rect', f'{side}/image_rect')])
        nodes.append(rectify)
    inputs = [(side, topic) for side in SIDES for topic in ('image', 'camera_info')]
    player = component(
        'Player', 'ros2_benchmark', 'PlaybackNode',
        parameters=[{'data_formats': [
            'sensor_msgs/msg/' + {'image': 'Image', 'camera_info': 'CameraInfo'}[topic]
            for _, topic in inputs]}],
        remappings=[each for n, (side, topic) in enumerate(inputs) for each in (
            (f'buffer/input{n}', f'small/{side}/{topic}'), (f'input{n}', f'{side}/{topic}'))])
    loader = component(
        'Loader', 'ros2_benchmark', 'DataLoaderNode', remappings=list(recorded.items()))
    monitors = [
        component(
            f'Monitor{number}', 'ros2_benchmark', 'MonitorNode',
            parameters=[{'monitor_index': number,
                         'monitor_data_format': 'sensor_msgs/msg/Image'}],
            remappings=[('output', f'{side}/image_rect')])
        for number, side in enumerate(SIDES)]
    return [ComposableNodeContainer(
        name='perception',
        namespace=StereoRectifierTest.generate_namespace(),
        package='rclcpp_components',
        executable='component_container_mt',
        prefix=container_prefix,
        sigterm_timeout=container_sigterm_timeout,
        composable_node_descriptions=[loader, player] + monitors + nodes)]


def generate_test_description():
    return StereoRectifierTest.generate_test_description_with_nsys(launch_setup)


class StereoRectifierTest(ROS2BenchmarkTest):
    config = ROS2BenchmarkConfig(
        benchmark_name='Rectification of a stereo pair',
        input_data_path='datasets/r2b_dataset/r2b_datacenter',
        # Half a second is enough.
        input_data_start_time=1.0,
        input_data_end_time=1.5,
        playback_message_buffer_size=15,
        publisher_lower_frequency=20.0,
        publisher_upper_frequency=400.0,
        additional_fixed_publisher_rate_tests=[30.0],
        test_iterations=10,
        custom_report_info={'size': SMALL, 'robots': len(SIDES)})

    def test_benchmark(self):
        self.run_benchmark()
