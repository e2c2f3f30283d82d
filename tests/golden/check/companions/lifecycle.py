from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from sensor_msgs.msg import Image

class Late(LifecycleNode):
    def __init__(self, **kwargs):
        super().__init__("late", **kwargs)

    def on_configure(self, state):
        self.output = self.create_publisher(Image, "output", 10)
        self.create_subscription(Image, "image", self.output.publish, 10)
        return super().on_configure(state)

class Plain(Node):
    def __init__(self, **kwargs):
        super().__init__("plain", **kwargs)
        self.create_subscription(Image, "image", print, 10)
