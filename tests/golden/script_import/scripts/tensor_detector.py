"""
A detector on tensors, whose engine is built first.

The formats are negotiated, and one parameter is read from a file.
"""

import os
import shutil
import time

from isaac_ros_benchmark import TRTConverter
from launch_ros.actions import ComposableNodeContainer
from launch_ros.descriptions import ComposableNode
from ros2_benchmark import Resolution, ROS2BenchmarkConfig, ROS2BenchmarkTest

NETWORK = Resolution(640, 480)
ENGINE = '/tmp/cell/detector.plan'
LABELS = '/tmp/cell/labels.txt'


def launch_setup(prefix, timeout):
    with open(LABELS) as file:
        labels = file.read().splitlines()
    space = DetectorTest.generate_namespace()
    encoder = ComposableNode(
        name='PrepEncoder', namespace=space, package='cell_encoder',
        plugin='cell::Encoder',
        parameters=[{'network': {'width': NETWORK['width'], 'height': NETWORK['height']},
                     'half': NETWORK['width'] / 2}],
        remappings=[('image', 'loaded/image'), ('tensor', 'buffer/tensor')])
    detector = ComposableNode(
        name='Detector', namespace=space, package='cell_detector',
        plugin='cell::Detector',
        parameters=[os.path.join(os.path.dirname(__file__), 'detector.yaml'),
                    {'engine': ENGINE, 'labels': labels, 'threshold': 0.5}],
        remappings=[('tensor_pub', 'tensor')])
    loader = ComposableNode(
        name='Loader', namespace=space, package='ros2_benchmark',
        plugin='ros2_benchmark::DataLoaderNode',
        remappings=[('d455_1_rgb_image', 'loaded/image')])
    player = ComposableNode(
        name='Player', namespace=space, package='isaac_ros_benchmark',
        plugin='isaac_ros_benchmark::NitrosPlaybackNode',
        parameters=[{'data_formats': ['nitros_tensor_list_nchw_rgb_f32']}],
        remappings=[('buffer/input0', 'buffer/tensor'), ('input0', 'tensor')])
    monitor = ComposableNode(
        name='Monitor', namespace=space, package='isaac_ros_benchmark',
        plugin='isaac_ros_benchmark::NitrosMonitorNode',
        parameters=[{'monitor_data_format': 'nitros_detection2_d_array'}],
        remappings=[('output', 'detections')])
    return [ComposableNodeContainer(
        name='detector_container', namespace=space, package='rclcpp_components',
        executable='component_container',
        composable_node_descriptions=[loader, encoder, player, detector, monitor])]


def generate_test_description():
    models = os.path.join(DetectorTest.get_assets_root_path(), 'models')
    if not os.path.exists('/tmp/cell'):
        os.makedirs('/tmp/cell')
    shutil.copy(f'{models}/labels.txt', LABELS)
    # The engine depends on the graphics card.
    if not os.path.isfile(ENGINE):
        print('building')
        TRTConverter()([f'--onnx={models}/detector.onnx', f'--saveEngine={ENGINE}', '--fp16'])
    return DetectorTest.generate_test_description_with_nsys(launch_setup)


class DetectorTest(ROS2BenchmarkTest):
    config = ROS2BenchmarkConfig(
        benchmark_name='Detector',
        input_data_path='datasets/r2b_dataset/r2b_lounge',
        playback_message_buffer_size=1,
        publisher_upper_frequency=50.0,
        favourite_colour='blue')

    def pre_benchmark_hook(self):
        # Loading takes a while.
        while not os.path.isfile(ENGINE):
            time.sleep(1)
        time.sleep(20)

    def test_benchmark(self):
        self.run_benchmark()
