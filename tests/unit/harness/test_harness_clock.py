"""The bytes of /clock are those of rosgraph_msgs/Clock."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")

from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock

from r2bspec.harness.observer import clock_message


def test_a_time_is_read_as_it_was_written() -> None:
    read = deserialize_message(clock_message(1_700_000_000_123_456_789), Clock)
    assert (read.clock.sec, read.clock.nanosec) == (1_700_000_000, 123_456_789)
