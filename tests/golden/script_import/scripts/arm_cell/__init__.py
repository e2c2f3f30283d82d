"""Goals for an arm, and how long its planner takes for them."""

import time

from arm_cell_interfaces.action import Plan
from rclpy.action import ActionClient
from ros2_benchmark import ROS2BenchmarkConfig, ROS2BenchmarkTest


class ArmTest(ROS2BenchmarkTest):
    config = ROS2BenchmarkConfig(benchmark_name='Arm', test_iterations=3)
    pose = 'home'

    def test_benchmark(self):
        client = ActionClient(self.node, Plan, '/plan')
        client.wait_for_server()
        time.sleep(3)
        for pose in self.poses():
            self.print_report(client.send_goal(Plan.Goal(pose=pose)))
