"""Scripts of ros2_benchmark and launch files as specs: read by syntax tree, never executed."""
