from launch import LaunchDescription
from launch_ros.actions import ComposableNodeContainer, Node

def generate_launch_description():
    return LaunchDescription([
        Node(package="nav", executable="talker", name="first"),
        ComposableNodeContainer(
            package="rclcpp_components", executable="component_container", name="second"),
    ])
