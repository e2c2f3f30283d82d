"""Nodes as they are written for ``ros2 run`` run as they are."""

from __future__ import annotations

import json
from typing import Any

import pytest

pytest.importorskip("rclpy")

from ros_runs import Bench, Finished, relay_spec
from ros_runs import nothing_left as nothing_left

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


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    found = Bench(tmp_path_factory.mktemp("ordinary"))
    found.write_node("nodes.py", NODES)
    return found


def chain(placement: str) -> dict[str, Any]:
    return relay_spec(
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
                    "publishes": {"out": "sensor_msgs/msg/Image"},
                    "subscribes": {"in": "sensor_msgs/msg/Image"},
                    "remappings": {"in": "second", "out": "output"},
                },
            },
        }
    )


def run_until_nothing_is_lost(bench: Bench, spec: dict[str, Any]) -> Finished:
    """One of three runs: with queues of ten messages, a busy machine loses some by itself."""
    for _ in range(3):
        done = bench.run(spec)
        done.assert_complete()
        if '"missed": 0' in json.dumps(done.result()["metrics"]):
            break
    return done


@pytest.mark.parametrize("placement", ["separate", "shared"])
def test_nodes_without_keyword_arguments_run_in_processes_of_their_own(
    bench: Bench, placement: str
) -> None:
    done = run_until_nothing_is_lost(bench, chain(placement))
    assert {"bright", "middle", "last"} <= {each.name for each in done.run().record.processes}
    text = json.dumps(done.result()["metrics"])
    assert '"missed": 0' in text
    assert '"received": 20' in text


def test_nodes_with_simulated_time_receive_the_clock(bench: Bench) -> None:
    spec = relay_spec(
        graph={
            "nodes": {
                "clocked": {
                    "python": "./nodes.py:Clocked",
                    "parameters": {"use_sim_time": True},
                }
            }
        }
    )
    spec["playback"]["clock"] = True
    done = run_until_nothing_is_lost(bench, spec)
    assert "R2B233" not in done.stderr
    assert '"missed": 0' in json.dumps(done.result()["metrics"])


def test_a_constructor_that_swallows_its_arguments_is_named(bench: Bench) -> None:
    spec = chain("separate")
    spec["graph"]["nodes"] = {
        "relay": {
            "python": "./nodes.py:Ignores",
            "publishes": {"output": "sensor_msgs/msg/Image"},
            "subscribes": {"input": "sensor_msgs/msg/Image"},
        }
    }
    done = bench.run(spec)
    assert "node /r2b/relay has the name /ignores" in done.error
    assert "Pass the **kwargs" in done.error
