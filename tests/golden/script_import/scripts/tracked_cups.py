"""
A tracker of cups, which is told by a service what it follows.

Its engine is made by a class of another package.
"""

import os
import subprocess
import time

from cell_msgs.msg import Box
from cell_msgs.srv import Follow, Forget
from isaac_ros_ess.engine_generator import ESSEngineGenerator
from launch_ros.actions import ComposableNodeContainer, Node
from launch_ros.descriptions import ComposableNode
from ros2_benchmark import ROS2BenchmarkConfig, ROS2BenchmarkTest
from std_srvs.srv import Trigger


def launch_setup(prefix, timeout):
    space = CupTest.generate_namespace()
    harness = {'namespace': space, 'package': 'ros2_benchmark'}
    # Its memory grows with the number of cups.
    tracker = ComposableNode(
        name='Tracker', namespace=space, package='cell_tracker', plugin='cell::Tracker',
        parameters=[{'memory': 12}],
        remappings=[('image', 'camera/image'), ('tracks', 'cups')])
    lamp = Node(
        name='lamp', namespace=space, package='cell_light', executable='lamp',
        parameters=[{'watts': 3.5}], remappings=[('switch', 'cups')])
    loader = ComposableNode(
        name='Loader', plugin='ros2_benchmark::DataLoaderNode',
        remappings=[('hawk_0_left_rgb_image', 'loaded/image')], **harness)
    player = ComposableNode(
        name='Player', plugin='ros2_benchmark::PlaybackNode',
        parameters=[{'data_formats': ['sensor_msgs/msg/Image']}],
        remappings=[('buffer/input0', 'loaded/image'), ('input0', 'camera/image')], **harness)
    monitor = ComposableNode(
        name='Monitor', plugin='ros2_benchmark::MonitorNode',
        parameters=[{'monitor_data_format': 'geometry_msgs/msg/PoseArray'}],
        remappings=[('output', 'cups')], **harness)
    return [lamp, ComposableNodeContainer(
        name='cup_container', namespace=space, package='rclcpp_components',
        executable='component_container_mt',
        composable_node_descriptions=[loader, player, tracker, monitor])]


def generate_test_description():
    model = os.path.join(CupTest.get_assets_root_path(), 'models', 'cups.onnx')
    # Takes a quarter of an hour.
    if not os.path.isfile(model.replace('.onnx', '.engine')):
        ESSEngineGenerator(onnx_model=model, arch='x86_64').generate()
    return CupTest.generate_test_description_with_nsys(launch_setup)


class CupTest(ROS2BenchmarkTest):
    config = ROS2BenchmarkConfig(
        benchmark_name='Cups',
        input_data_path='datasets/r2b_dataset/r2b_cafe',
        playback_message_buffer_size=10,
        publisher_upper_frequency=60.0)

    def pre_benchmark_hook(self):
        time.sleep(5)
        self.follow_one()
        self.reset()
        self.ask_file()

    def follow_one(self):
        # The cup in the middle.
        client = self.create_service_client_blocking(Follow, 'follow')
        box = Box()
        box.center.position.x = 847.5
        box.size = 40
        request = Follow.Request()
        request.header.frame_id = 'camera'
        request.names = ['cup']
        request.boxes = [box]
        answer = client.call_async(request)
        self.get_service_response_from_future_blocking(answer, check_success=True)

    def reset(self):
        client = self.node.create_client(Trigger, self.generate_namespace('reset'))
        client.wait_for_service()
        client.call(Trigger.Request())

    def ask_file(self):
        client = self.create_service_client_blocking(Follow, 'follow')
        with open('/tmp/names') as file:
            client.call_async(Follow.Request(names=file.read().split()))

    def post_benchmark_hook(self):
        subprocess.run(['rm', '-rf', '/tmp/cups'])
        client = self.create_service_client_blocking(Forget, 'forget')
        client.call_async(Forget.Request())

    def test_benchmark(self):
        self.run_benchmark()
