"""The publisher of /clock, for nodes with `use_sim_time`."""

from __future__ import annotations

import struct
import threading
import time

from rclpy.node import Node

from r2bspec.harness import rclpy_tools
from r2bspec.language.spec import QoS

CLOCK, CLOCK_TYPE = "/clock", "rosgraph_msgs/msg/Clock"

_PERIOD_S = 0.01
_CLOCK_QOS = QoS(depth=1)


def clock_message(time_ns: int) -> bytes:
    """A serialised rosgraph_msgs/Clock (XCDR1, little-endian: int32 seconds, uint32 nanoseconds).

    Args:
        time_ns: nanoseconds since the epoch.
    """
    seconds, nanoseconds = divmod(time_ns, 10**9)
    return b"\x00\x01\x00\x00" + struct.pack("<iI", seconds, nanoseconds)


class ClockPublisher:
    """Publishes the system time on /clock 100 times per second, from its construction.

    The stamps that the player writes are of the system clock, so that both agree for a node. Each
    message has the time at which it is published; periods that were missed are left out.
    """

    def __init__(self, node: Node) -> None:
        self._publisher = rclpy_tools.RawPublisher(
            node, CLOCK, CLOCK_TYPE, rclpy_tools.profile(_CLOCK_QOS)
        )
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._publish, name="clock", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop publishing; the node may then be destroyed."""
        self._ended.set()
        self._thread.join()

    def _publish(self) -> None:
        due_s = time.monotonic() + _PERIOD_S
        while not self._ended.wait(max(0.0, due_s - time.monotonic())):
            self._publisher.publish(clock_message(time.time_ns()))
            due_s = max(due_s + _PERIOD_S, time.monotonic())
