"""The programs of child processes: loader, player, monitor, node host and service client.

This package and `r2bspec.nodes` are the only ones that import rclpy, and only in modules that a
child process runs. The code that they share with the controller is in `r2bspec.ipc`.
"""
