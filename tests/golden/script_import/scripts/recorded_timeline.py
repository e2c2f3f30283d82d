"""A map from what was recorded, played at its own times, in two containers."""

from launch_ros.actions import ComposableNodeContainer
from launch_ros.descriptions import ComposableNode
from ros2_benchmark import BenchmarkMode, ROS2BenchmarkConfig, ROS2BenchmarkTest


def launch_setup(prefix, timeout):
    space = MapTest.generate_namespace()
    loader = ComposableNode(
        name='Loader', namespace=space, package='ros2_benchmark',
        plugin='ros2_benchmark::DataLoaderNode',
        parameters=[{'publisher_period_ms': 1}],
        remappings=[('pandar_xt_32_0_lidar', 'loaded/points')])
    odometry = ComposableNode(
        name='PrepOdometry', namespace=space, package='cell_odometry', plugin='cell::Odometry',
        remappings=[('imu', 'd455_1_imu'), ('/tf', 'loaded/tf')])
    player = ComposableNode(
        name='Player', namespace=space, package='ros2_benchmark',
        plugin='ros2_benchmark::PlaybackNode',
        parameters=[{'data_formats': ['sensor_msgs/msg/PointCloud2', 'tf2_msgs/msg/TFMessage']}],
        remappings=[('buffer/input0', 'loaded/points'), ('input0', 'points'),
                    ('buffer/input1', 'loaded/tf'), ('input1', '/tf')])
    mapper = ComposableNode(
        name='Mapper', namespace=space, package='cell_mapper', plugin='cell::Mapper',
        remappings=[('cloud', 'points')])
    monitor = ComposableNode(
        name='Monitor', namespace=space, package='ros2_benchmark',
        plugin='ros2_benchmark::MonitorNode',
        parameters=[{'monitor_data_format': 'nav_msgs/msg/OccupancyGrid'}],
        remappings=[('output', 'Mapper/map')])
    common = {'namespace': space, 'package': 'rclcpp_components',
              'executable': 'component_container_mt'}
    return [
        ComposableNodeContainer(
            name='first', composable_node_descriptions=[loader, odometry, player], **common),
        ComposableNodeContainer(
            name='second', composable_node_descriptions=[mapper, monitor], **common)]


def generate_test_description():
    return MapTest.generate_test_description(launch_setup('', 5))


class MapTest(ROS2BenchmarkTest):
    config = ROS2BenchmarkConfig(
        benchmark_name='Map',
        benchmark_mode=BenchmarkMode.TIMELINE,
        input_data_path='datasets/r2b_dataset/r2b_hallway',
        load_data_in_real_time=True,
        record_data_timeline=True,
        playback_message_buffer_size=0)

    def test_benchmark(self):
        self.run_benchmark()
