"""The part of the harness in C, and its builder.

Player and monitor are C on rcl's public API (``*.c`` and ``harness.h`` in this folder). They are
compiled on first use, on the machine that runs them and against the ROS that it uses. So are the
objects that are preloaded into processes of the graph, which need no ROS for that: ``join.c`` loads
the harness into a process, ``anatomy*.c`` record its events.
"""
