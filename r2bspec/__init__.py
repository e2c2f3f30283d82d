"""State, run and gate performance benchmarks of ROS 2 graphs."""
