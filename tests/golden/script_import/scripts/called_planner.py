"""The time to a plan, which the script asks for itself."""

from cell_interfaces.action import Plan
from cell_interfaces.srv import Reset
from launch_ros.actions import Node
from rclpy.action import ActionClient
from ros2_benchmark import ROS2BenchmarkConfig, ROS2BenchmarkTest


def launch_setup(prefix, timeout):
    return [Node(name='planner', namespace='/r2b', package='cell_planner', executable='planner')]


def generate_test_description():
    return PlannerTest.generate_test_description_with_nsys(launch_setup)


class CallingTest(ROS2BenchmarkTest):
    config = ROS2BenchmarkConfig(benchmark_name='Planner', test_iterations=3)

    def test_benchmark(self):
        self._client = ActionClient(self.node, Plan, '/cell/plan')
        self._again = self.node.create_client(Reset, 'reset')
        for pose in self.poses():
            self._client.send_goal(self.goal(pose))


class PlannerTest(CallingTest):
    def poses(self):
        return []
