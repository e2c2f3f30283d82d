"""What runs inside child processes: loader, player, monitor and node host.

This package and `r2bspec.nodes` are the only ones that import rclpy, and only in modules that a
child process runs. `protocol`, `channel`, `rows`, `buffers` and `reaping` are shared with the
controller and need no ROS.
"""
