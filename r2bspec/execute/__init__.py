"""The controller: carries a plan out on real ROS 2 and leaves a run folder behind."""
