"""Reading what other tools write: scripts of ros2_benchmark and launch files."""
