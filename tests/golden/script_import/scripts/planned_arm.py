"""A planner that answers goals, with its scene in the same process."""

from arm_cell import ArmTest
from launch_ros.actions import ComposableNodeContainer
from launch_ros.descriptions import ComposableNode


def launch_setup(prefix, timeout):
    ArmTest.config.benchmark_name = 'Planner of the arm'
    # Messages between both are not copied.
    shared = [{'use_intra_process_comms': True}]
    return [ComposableNodeContainer(
        name='planning', package='rclcpp_components', executable='component_container_mt',
        parameters=[{'thread_num': 3}], arguments=['--ros-args', '--log-level', 'warn'],
        composable_node_descriptions=[
            ComposableNode(name='planner', package='arm_cell', plugin='arm_cell::Planner',
                           extra_arguments=[*shared, {'forward_global_arguments': False}]),
            ComposableNode(name='scene', package='arm_cell', plugin='arm_cell::Scene',
                           extra_arguments=shared)])]


def generate_test_description():
    return ArmTest.generate_test_description_with_nsys(launch_setup)
