"""Nodes as they are written for ``ros2 run`` run as they are."""

from __future__ import annotations

from typing import Any

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from ros_runs import IMAGE, Bench, relay_spec
from ros_runs import bench as bench

# The first is the node of the tutorials; the second has defaults only; the third brings its main.
NODES = """
import rclpy
from rclpy.executors import ExternalShutdownException


class Brightness(Node):
    def __init__(self):
        super().__init__("brightness")
        self.declare_parameter("gain", 1.0)
        self.declare_parameter("label", "")
        self.publisher = self.create_publisher(Image, "bright", 10)
        self.create_subscription(Image, "image", self.on_image, 10)

    def on_image(self, message):
        assert self.get_parameter("gain").value == 2.5
        assert self.get_parameter("label").value == 'a "quoted": 10'
        self.publisher.publish(message)


class Defaults(Node):
    def __init__(self, node_name="something", depth=10):
        super().__init__(node_name)
        self.publisher = self.create_publisher(Image, "~/out", depth)
        self.create_subscription(Image, "in", self.publisher.publish, depth)


class Last(Node):
    def __init__(self):
        super().__init__("last")
        self.publisher = self.create_publisher(Image, "out", 10)
        self.create_subscription(Image, "in", self.publisher.publish, 10)


def main(args=None):
    rclpy.init(args=args)
    try:
        rclpy.spin(Last())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


class Clocked(Node):
    # Answers only while its clock, which is that of the topic /clock, has the time of stamps.

    def __init__(self):
        super().__init__("clocked")
        self.publisher = self.create_publisher(Image, "output", 10)
        self.create_subscription(Image, "input", self.on_image, 10)
        self.create_timer(0.05, self.tick)
        self.ticks = 0

    def tick(self):
        self.ticks += 1

    def on_image(self, message):
        assert self.get_clock().ros_time_is_active
        now_s = self.get_clock().now().nanoseconds / 1e9
        if self.ticks and abs(now_s - message.header.stamp.sec) < 600:
            self.publisher.publish(message)


class Ignores(Node):
    def __init__(self, **kwargs):
        super().__init__("ignores")


if __name__ == "__main__":
    raise SystemExit("it was run as a script")
"""


def chain(placement: str) -> dict[str, Any]:
    """Three nodes in a row, and one beside them that has the time of the stamps."""
    spec = relay_spec(
        graph={
            "placement": placement,
            "nodes": {
                "bright": {
                    "python": "./nodes.py:Brightness",
                    "remappings": {"image": "input", "bright": "first"},
                    "parameters": {"gain": 2.5, "label": 'a "quoted": 10'},
                },
                "middle": {
                    "python": "./nodes.py:Defaults",
                    "namespace": "inner",
                    "remappings": {"in": "/r2b/first", "~/out": "/r2b/second"},
                },
                "last": {
                    "python": "./nodes.py:main",
                    "publishes": {"out": IMAGE},
                    "subscribes": {"in": IMAGE},
                    "remappings": {"in": "second", "out": "output", "lost": "nowhere"},
                },
                "clocked": {
                    "python": "./nodes.py:Clocked",
                    "parameters": {"use_sim_time": True},
                    "remappings": {"output": "timed"},
                },
            },
        },
        monitors={
            "out": {"topic": "output", "format": IMAGE},
            "timed": {"topic": "timed", "format": IMAGE},
        },
    )
    spec["playback"]["clock"] = True
    return spec


@pytest.mark.parametrize("placement", ["separate", pytest.param("shared", marks=only_nightly())])
def test_nodes_without_keyword_arguments_run_as_they_are(bench: Bench, placement: str) -> None:
    # With queues of ten messages, a busy machine loses some by itself.
    for _ in range(3):
        done = bench.run(chain(placement))
        done.assert_complete()
        if not done.monitor()["missed"] and not done.monitor("timed")["missed"]:
            break
    assert {"bright", "middle", "last"} <= {process.name for process in done.run().record.processes}
    assert "R2B233" not in done.stderr
    assert "R2B204" in done.stderr, "a remapping without effect is a warning"
    for monitor in ("out", "timed"):
        done.assert_counts(20, monitor)


@only_nightly()
def test_a_constructor_that_swallows_its_arguments_is_named(bench: Bench) -> None:
    spec = chain("separate")
    del spec["monitors"]["timed"]
    spec["graph"]["nodes"] = {
        "relay": {
            "python": "./nodes.py:Ignores",
            "publishes": {"output": IMAGE},
            "subscribes": {"input": IMAGE},
        }
    }
    done = bench.run(spec)
    assert "node /r2b/relay has the name /ignores" in done.error
    assert "Pass the **kwargs" in done.error
