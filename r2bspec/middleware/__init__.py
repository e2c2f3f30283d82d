"""What differs between ROS middlewares (RMW): one module for each."""
