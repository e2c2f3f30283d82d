"""What it costs to publish and to take a message through rclpy, and by calling rcl directly.

    python tests/bench/rcl_calls.py

One process, both ways in turn, so that a disturbance touches both alike. Prints Markdown.
"""

from __future__ import annotations

import functools
import os
import statistics
import sys
import time
from collections.abc import Callable

from floor_workloads import LARGE, MEDIUM, SMALL, TYPE, message

from r2bspec.harness import rcl_calls, rclpy_tools
from r2bspec.language.spec import QoS

_TURNS = 200
_PAUSE_S = 0.002


def main() -> int:
    from rclpy.serialization import serialize_message

    node = rclpy_tools.start_node("calls")
    writer = rclpy_tools.RawPublisher(node, "/calls", TYPE, rclpy_tools.profile(QoS()))
    reader = rclpy_tools.RawSubscription(node, "/calls", TYPE, rclpy_tools.profile(QoS()))
    while not writer.matches():
        time.sleep(0.01)
    taker = rcl_calls.MessageTaker(reader.handle)
    _print("| message | publish: rclpy, rcl | take: rclpy, rcl |")
    _print("| --- | --- | --- |")
    for size in (SMALL, MEDIUM, LARGE):
        data = bytearray(serialize_message(message(size)))
        by_rclpy = functools.partial(writer.publish, data), reader.take
        by_rcl = writer.publication(data), taker.take
        ways: tuple[tuple[Callable[[], object], Callable[[], object]], ...] = by_rclpy, by_rcl
        times: list[list[tuple[int, int]]] = [[], []]
        for _ in range(_TURNS):
            for (publish, take), found in zip(ways, times, strict=True):
                published = _timed(publish)
                time.sleep(_PAUSE_S)
                found.append((published, _timed(take)))
        cells = [
            ", ".join(f"{statistics.median(turn[step] for turn in way) / 1e6:.3f}" for way in times)
            for step in (0, 1)
        ]
        _print(f"| {size:,} B | {cells[0]} ms | {cells[1]} ms |")
    rclpy_tools.finish()
    os._exit(0)


def _timed(call: Callable[[], object]) -> int:
    began_ns = time.perf_counter_ns()
    call()
    return time.perf_counter_ns() - began_ns


def _print(text: str) -> None:
    print(text, flush=True)  # noqa: T201 - a program


if __name__ == "__main__":
    sys.exit(main())
