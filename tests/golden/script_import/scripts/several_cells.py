"""Three cells in namespaces of their own, from one launch file, in one container."""

from launch.actions import GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import LoadComposableNodes, Node, SetRemap
from launch_ros.descriptions import ComposableNode
from launch_ros.substitutions import FindPackageShare
from ros2_benchmark import BasicPerformanceCalculator, MonitorPerformanceCalculatorsInfo
from ros2_benchmark import ROS2BenchmarkConfig, ROS2BenchmarkTest

CELLS = ('cell_1', 'cell_2', 'cell_3')


class Counted:
    def __init__(self):
        self.infos = []

    def monitor(self, cell, space):
        number = len(self.infos)
        self.infos.append(MonitorPerformanceCalculatorsInfo(
            f'monitor_node{number}',
            [BasicPerformanceCalculator({'report_prefix': f'({cell}) rectified'})]))
        return ComposableNode(
            name=f'{cell}_monitor', namespace=space, package='ros2_benchmark',
            plugin='ros2_benchmark::MonitorNode',
            parameters=[{'monitor_index': number,
                         'monitor_data_format': 'sensor_msgs/msg/Image'}],
            remappings=[('output', f'/{cell}/rectified')])


COUNTED = Counted()


def launch_setup(prefix, timeout):
    space = CellsTest.generate_namespace()
    container = Node(
        name='cells', package='rclcpp_components', executable='component_container_mt')
    groups = [
        GroupAction(actions=[
            SetRemap(src='Rectify:image', dst=f'{space}/camera/image'),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(
                    [FindPackageShare('stereo_cell'), '/launch/cell.launch.py']),
                launch_arguments={'space': cell, 'queue': '7' if cell == 'cell_2' else '5'}.items())
        ])
        for cell in CELLS]
    groups.append(IncludeLaunchDescription(
        PythonLaunchDescriptionSource([FindPackageShare('cell_description'), '/launch/all.py']),
        launch_arguments={'robot': 'cell'}.items()))
    harness = [
        ComposableNode(
            name='Loader', namespace=space, package='ros2_benchmark',
            plugin='ros2_benchmark::DataLoaderNode',
            remappings=[('d455_1_rgb_image', 'loaded/image'),
                        ('d455_1_rgb_camera_info', 'loaded/camera_info')]),
        ComposableNode(
            name='Player', namespace=space, package='ros2_benchmark',
            plugin='ros2_benchmark::PlaybackNode',
            parameters=[{'data_formats': ['sensor_msgs/msg/Image', 'sensor_msgs/msg/CameraInfo']}],
            remappings=[('buffer/input0', 'loaded/image'), ('input0', 'camera/image'),
                        ('buffer/input1', 'loaded/camera_info'), ('input1', 'camera/camera_info')]),
    ] + [COUNTED.monitor(cell, space) for cell in CELLS]
    return [container, LoadComposableNodes(
        target_container='cells', composable_node_descriptions=harness)] + groups


def generate_test_description():
    return CellsTest.generate_test_description_with_nsys(launch_setup)


class CellsTest(ROS2BenchmarkTest):
    # At the rate of the cameras only.
    config = ROS2BenchmarkConfig(
        benchmark_name='Three cells at 30 Hz',
        input_data_path='datasets/r2b_dataset/r2b_storage',
        publisher_upper_frequency=30.0,
        publisher_lower_frequency=30.0,
        additional_fixed_publisher_rate_tests=[],
        monitor_info_list=[])

    def test_benchmark(self):
        self.config.monitor_info_list = COUNTED.infos
        self.run_benchmark()
