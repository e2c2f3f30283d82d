"""The peer: a plain publisher and a plain subscriber, as a tutorial writes them.

Two processes, typed messages, a timer, rclpy's own executor, the transports and the allocator that
a process has by default. The subscriber keeps both times: when the middleware had the message, and
when the callback had it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from floor_workloads import TOPIC, Figures, Workload, cpu_ns, figures, message

from r2bspec.execute.processes.prerequisites import reserved_domain
from r2bspec.record.sample_arrays import MONITOR_FIELDS, PLAYBACK_FIELDS

_WARM_UP_S = 2.0
_ROW = 4


def measure_peer(workload: Workload, seconds: float) -> Figures:
    """Run publisher and subscriber for a time and say how it went."""
    with tempfile.TemporaryDirectory() as scratch, reserved_domain() as domain:
        environment = os.environ | {
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        arguments = [str(workload.size), str(workload.rate_hz), str(seconds)]
        files = [Path(scratch) / name for name in ("published", "received")]
        pair = [
            subprocess.Popen(
                [sys.executable, __file__, role, str(file), *arguments],
                env=environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
            )
            for role, file in zip(("publish", "subscribe"), files, strict=True)
        ]
        publisher, subscriber = pair
        try:
            # The publisher says so when it is warm, and when it has published everything.
            _line(publisher)
            before = cpu_ns(each.pid for each in pair)
            _line(publisher)
            time.sleep(0.5)
            spent = cpu_ns(each.pid for each in pair) - before
            for each in (publisher, subscriber):
                each.communicate(b"end\n", timeout=30.0)
        finally:
            for each in pair:
                each.kill()
                each.wait()
        published, received = (np.fromfile(file, np.int64).reshape(-1, _ROW) for file in files)
    return figures(_rows(published, PLAYBACK_FIELDS), _rows(received, MONITOR_FIELDS), spent)


def _line(process: subprocess.Popen[bytes]) -> None:
    if process.stdout is None or not process.stdout.readline():
        raise RuntimeError("the peer ended early")


def _rows(values: Any, names: tuple[tuple[str, str], ...]) -> Any:
    """Rows with these fields, as far as the peer writes them."""
    return np.ascontiguousarray(values).view(np.dtype(list(names[:_ROW])))[:, 0]


def _publish(file: Path, size: int, rate_hz: float, seconds: float) -> None:
    import rclpy
    from sensor_msgs.msg import Image

    rclpy.init()
    node = rclpy.create_node("peer_publisher")
    publisher = node.create_publisher(Image, TOPIC, 10)
    while not publisher.get_subscription_count():
        time.sleep(0.02)
    made = message(size)
    rows: list[tuple[int, int, int, int]] = []
    period_ns = round(1e9 / rate_hz)
    warm_ns = round(_WARM_UP_S * 1e9)
    created_ns = 0

    def publish() -> None:
        now_ns = time.monotonic_ns()
        stamp_ns = time.time_ns()
        made.header.stamp.sec, made.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        # A timer keeps to multiples of its period, and leaves out those that it has missed.
        late_ns = (now_ns - created_ns) % period_ns
        published_ns = time.monotonic_ns()
        publisher.publish(made)
        rows.append((stamp_ns, now_ns - late_ns, published_ns, time.monotonic_ns()))

    created_ns = time.monotonic_ns()
    node.create_timer(1 / rate_hz, publish)
    executor = rclpy.executors.SingleThreadedExecutor()
    executor.add_node(node)
    _spin(executor, created_ns + warm_ns)
    rows.clear()
    print("warm", flush=True)  # noqa: T201 - told to the parent
    _spin(executor, time.monotonic_ns() + round(seconds * 1e9))
    print("done", flush=True)  # noqa: T201 - told to the parent
    sys.stdin.readline()
    np.array(rows, np.int64).tofile(file)


def _subscribe(file: Path) -> None:
    import threading

    import rclpy
    from sensor_msgs.msg import Image

    rclpy.init()
    node: Any = rclpy.create_node("peer_subscriber")
    rows: list[tuple[int, int, int, int]] = []

    def receive(image: Any, info: Any) -> None:
        taken_ns, system_ns = time.monotonic_ns(), time.time_ns()
        stamp = image.header.stamp
        received_ns = info["received_timestamp"] - (system_ns - taken_ns)
        rows.append((stamp.sec * 10**9 + stamp.nanosec, received_ns, taken_ns, 0))

    node.create_subscription(Image, TOPIC, receive, 10)
    executor = rclpy.executors.SingleThreadedExecutor()
    executor.add_node(node)
    threading.Thread(target=executor.spin, daemon=True).start()
    sys.stdin.readline()
    np.array(rows, np.int64).tofile(file)
    os._exit(0)


def _spin(executor: Any, end_ns: int) -> None:
    while time.monotonic_ns() < end_ns:
        executor.spin_once(timeout_sec=0.1)


if __name__ == "__main__":
    role, path, size, rate_hz, seconds = sys.argv[1:]
    if role == "publish":
        _publish(Path(path), int(size), float(rate_hz), float(seconds))
    else:
        _subscribe(Path(path))
