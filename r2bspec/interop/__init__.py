"""What other tools read and write: the report of NVIDIA's ros2_benchmark."""
