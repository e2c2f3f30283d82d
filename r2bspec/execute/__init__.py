"""The controller: executes a plan on ROS 2 and writes a run folder."""
