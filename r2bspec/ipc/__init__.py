"""What the controller and its child processes share: messages, schedules and files. No rclpy."""
