"""One cell: a rectifier, loaded into the container 'cells'."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LoadComposableNodes
from launch_ros.descriptions import ComposableNode


def setup(context):
    space = LaunchConfiguration('space').perform(context)
    return [LoadComposableNodes(
        target_container=LaunchConfiguration('container'),
        composable_node_descriptions=[ComposableNode(
            name='Rectify',
            namespace=space,
            package='image_proc',
            plugin='image_proc::RectifyNode',
            parameters=[{'queue_size': LaunchConfiguration('queue')}],
            remappings=[('image', 'never/used'), ('image_rect', 'rectified')])])]


def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument('space', default_value='cell'),
        DeclareLaunchArgument('container', default_value='cells'),
        DeclareLaunchArgument('queue', default_value='5'),
        OpaqueFunction(function=setup)])
