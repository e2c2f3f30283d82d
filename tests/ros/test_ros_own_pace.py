"""Outputs of a timer: nothing is waited for that never ends, and what fits them can be required."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")

from ros_runs import IMAGE, Bench, Finished, relay_spec
from ros_runs import bench as bench

NODES = """
class Ticks(Node):
    # Publishes four times as often as it gets inputs.
    def __init__(self, **kwargs):
        super().__init__("ticks", **kwargs)
        self.newest = None
        self.create_subscription(Image, "input", self.take, 10)
        self.repeats = self.create_publisher(Image, "repeats", 10)
        self.stamps = self.create_publisher(Image, "stamps", 10)
        self.create_timer(0.025, self.tick)

    def take(self, message):
        self.newest = message

    def tick(self):
        own = Image()
        own.header.stamp = self.get_clock().now().to_msg()
        self.stamps.publish(own)
        if self.newest is not None:
            self.repeats.publish(self.newest)
"""


@pytest.fixture(scope="module")
def done(bench: Bench) -> Finished:
    spec = relay_spec(
        graph={
            "nodes": {
                "ticks": {
                    "python": "./nodes.py:Ticks",
                    "scheduling": {"policy": "batch"},
                }
            }
        },
        monitors={
            "aged": {"topic": "repeats", "format": IMAGE, "match": "own_pace"},
            "repeated": {"topic": "repeats", "format": IMAGE},
            "stamped": {"topic": "stamps", "format": IMAGE},
        },
        benchmark=relay_spec()["benchmark"] | {"iterations": 2, "rates": ["10 Hz"]},
        slos={
            "fresh": {
                "at": "10 Hz",
                "require": ["aged.age.p50 < 100 s", "aged.throughput.mean > 0.1 Hz"],
            }
        },
    )
    return bench.run(spec)


def test_age_and_rate_are_judged(done: Finished) -> None:
    verdicts = {one["text"]: one["outcome"] for one in done.result()["verdict"]["requirements"]}
    assert verdicts["aged.age.p50 < 100 s"] == "pass", done.stderr


def test_the_drain_ends_although_messages_never_do(done: Finished) -> None:
    run = done.run()
    played = [each for each in run.record.segments if each.kind == "iteration"]
    assert len(played) == 2
    for segment in played:
        rows = run.monitor(segment, "stamped")["received_ns"]
        assert rows.size
        # A minute would be sixty times the segment.
        heard = np.count_nonzero(rows > segment.ended_ns)
        assert heard < 10 * np.count_nonzero(rows <= segment.ended_ns)


def test_nothing_is_missed_where_nothing_is_expected(done: Finished) -> None:
    (rate,) = done.result()["metrics"]["rates"]
    aged = rate["pooled"]["monitors"]["aged"]["values"]
    assert aged["missed"] is aged["drop_rate"] is None
    assert 0 < aged["age"]["n"] <= aged["received"]
    repeated = rate["pooled"]["monitors"]["repeated"]["values"]
    assert repeated["sent"] == 20
    assert "age" not in repeated


def test_what_the_threads_of_the_node_were_given_is_in_the_record(done: Finished) -> None:
    threads = {process.name: process.scheduling for process in done.run().record.processes}
    assert sum(each.count for each in threads["ticks"]) > 1
    assert {each.policy for each in threads["ticks"]} == {"batch"}
    assert threads["monitor"] == ()
