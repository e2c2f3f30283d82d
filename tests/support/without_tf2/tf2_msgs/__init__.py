"""Stands in for tf2_msgs where only the wheels of ROS are installed, which do not have it.

Used by tests that hand serialised transforms through the middleware and never through rclpy's
own conversion: what travels is what the real package would send, under the name of another type.
"""
