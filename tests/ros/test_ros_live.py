"""Promise: of a live graph is reported what is seen of it, and nothing else is made up."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

from r2bspec.judge.measure.anatomy_summary import join_segment
from r2bspec.judge.measure.run_samples import match_segment
from ros_runs import IMAGE, STRING, Bench, Finished, relay_node
from ros_runs import bench as bench

NODES = """
from std_msgs.msg import String


class Source(Node):
    def __init__(self, **kwargs):
        super().__init__("source", **kwargs)
        self.image = self.create_publisher(Image, "image", 10)
        self.old = self.create_publisher(Image, "old", 10)
        self.text = self.create_publisher(String, "text", 10)
        self.ticks = 0
        self.create_timer(0.05, self.tick)

    def tick(self):
        is_event = self.ticks % 4 == 0
        message = Image(height=int(is_event))
        self.old.publish(message)
        message.header.stamp = self.get_clock().now().to_msg()
        self.image.publish(message)
        self.text.publish(String(data="y" if is_event else "x"))
        self.ticks += 1
"""

SPEC: dict[str, Any] = {
    "r2bspec": 1,
    "name": "live",
    "playback": {"mode": "live"},
    "graph": {
        "nodes": {
            "source": {"python": "./nodes.py:Source"},
            "relay": relay_node(20.0, remappings={"input": "image"}),
        }
    },
    "monitors": {
        "image": {"topic": "image", "format": IMAGE},
        "out": {"topic": "output", "format": IMAGE},
        "old": {"topic": "old", "format": IMAGE},
        "text": {"topic": "text", "format": STRING, "match": "order"},
    },
    "benchmark": {
        "duration": "700 ms",
        "iterations": 2,
        "anatomy": True,
        "warm_up": "100 ms",
        "start_timeout": "60 s",
    },
    "slos": {
        "seen": {"require": ["image.received > 1", "text.received > 1", "out.latency.p50 < 100 s"]},
        "unknown": {"require": ["old.latency.p50 < 100 s"]},
    },
}


@pytest.fixture(scope="module")
def done(bench: Bench) -> Finished:
    return bench.run(SPEC, "--verbose")


@pytest.fixture(scope="module")
def pooled(done: Finished) -> Any:
    (rate,) = done.result()["metrics"]["rates"]
    assert rate["pace"] == "source"
    return rate["pooled"]


def test_the_run_is_complete_without_loader_and_player(done: Finished) -> None:
    assert done.status == 3, done.stderr
    record = done.run().record
    assert record.status == "complete"
    assert {process.name for process in record.processes} == {
        "harness.observer",
        "monitor",
        "source",
        "relay",
    }
    assert [segment.kind for segment in record.segments][-2:] == ["iteration", "iteration"]


def test_each_segment_has_what_was_received_in_its_time_and_the_offset_of_the_clocks(
    done: Finished,
) -> None:
    run = done.run()
    for segment in run.record.segments:
        assert segment.live
        assert segment.steps == run.playback(segment).size == 0
        assert segment.clock_offset_ns is not None
        for monitor in run.plan.monitors:
            received = run.monitor(segment, monitor.name)["received_ns"]
            assert np.all((segment.began_ns <= received) & (received < segment.ended_ns))


def test_latency_is_counted_from_the_stamp_of_the_source(pooled: Any) -> None:
    monitors = {name: seen["values"] for name, seen in pooled["monitors"].items()}
    assert monitors["image"]["latency"]["n"] == monitors["image"]["received"]
    # The relay takes 20 ms for each, whatever the machine does.
    assert monitors["out"]["latency"]["min"] > 0.02
    assert monitors["image"]["latency"]["min"] < monitors["out"]["latency"]["min"]


@pytest.mark.parametrize("name", ["old", "text"])
def test_without_a_time_of_this_machine_there_is_no_latency(pooled: Any, name: str) -> None:
    seen = pooled["monitors"][name]["values"]
    assert seen["received"] > 2
    assert seen["latency"]["n"] == 0
    assert seen["latency"]["p50"] is None
    assert seen["interval"]["n"] > 0
    assert seen["throughput.mean"] > 0


def test_what_nobody_knows_has_no_value(pooled: Any) -> None:
    assert not {"sent", "playback.rate"} & pooled["values"].keys()
    for seen in (pooled["monitors"][monitor] for monitor in ("image", "out", "old", "text")):
        for name in ("sent", "answered", "missed", "drop_rate", "duplicates", "unmatched"):
            assert seen["values"][name] is None


def test_what_is_unknown_never_passes(done: Finished) -> None:
    outcomes = {
        (one["text"], one["monitor"]): one["outcome"]
        for one in done.result()["verdict"]["requirements"]
    }
    assert outcomes["old.latency.p50 < 100 s", "old"] == "inconclusive"
    assert {
        outcome for (text, _), outcome in outcomes.items() if text != "old.latency.p50 < 100 s"
    } == {"pass"}


def test_the_parts_of_a_path_are_the_latency_from_the_stamp_of_the_source(done: Finished) -> None:
    run = done.run()
    (record,) = run.record.anatomies
    for segment in done.segments():
        seen = join_segment(run, segment, record)
        (path,) = seen.paths["out"]
        assert path.hops == ("source", "/r2b/image", "relay", "/r2b/output")
        assert path.parts[0].name == "earlier"
        steps, rows, matching = match_segment(run, segment, run.plan.monitors[1])
        stamped, received = steps["published_ns"], rows["received_ns"][matching.first_row]
        # What was on its way when the iteration began has no path in it.
        began = stamped > segment.began_ns
        latencies = (received - stamped)[began] / 1e9
        assert path.seconds.size >= latencies.size > 0
        nearest = np.abs(path.seconds[:, None] - latencies).min(axis=0)
        assert (nearest <= 0.02 * latencies).all()


def test_the_report_says_live_and_no_rate_of_playing(done: Finished) -> None:
    assert "live" in done.stdout
    assert " 0 Hz" not in done.stdout
