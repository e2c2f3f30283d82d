"""Code shared by the controller and its child processes: messages, schedules, files. No rclpy."""
