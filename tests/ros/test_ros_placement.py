"""Player and monitor in one process, alone and with nodes beside them."""

from __future__ import annotations

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from ros_runs import MEASURED, Bench, Finished, relay_node, relay_spec
from ros_runs import bench as bench

FAILS = """
class Fails(Node):
    def __init__(self, **kwargs):
        super().__init__("fails", **kwargs)
        self.out = self.create_publisher(Image, "output", 10)
        self.create_subscription(Image, "input", self.answer, 10)

    def answer(self, message):
        raise RuntimeError("lost the plot")
"""

IN_ONE = {"placement": "shared"}


@pytest.fixture(scope="module")
def beside(bench: Bench) -> Finished:
    """A run with a node beside player and monitor."""
    graph = {"placement": "harness", "nodes": {"relay": relay_node()}}
    return bench.run(relay_spec(graph=graph, playback=MEASURED))


def test_one_process_plays_watches_and_holds_the_nodes(beside: Finished) -> None:
    beside.assert_complete()
    record = beside.run().record
    # The processes that import ROS are started ahead of their turn: the order says nothing.
    assert sorted(
        (process.name, process.role, process.exit_code) for process in record.processes
    ) == [
        ("harness", "harness", 0),
        ("harness.observer", "observer", 0),
    ]
    (segment,) = beside.segments()
    out = beside.run().monitor(segment, "out")
    assert set(out["stamp_ns"]) == set(beside.run().playback(segment)["stamp_ns"])
    assert out.size == segment.steps == 20


def test_processor_time_of_the_harness_is_counted_once(beside: Finished) -> None:
    used = beside.pooled()["values"].keys()
    assert "cpu.harness.mean" in used
    assert not {f"cpu.{name}.mean" for name in ("player", "monitor", "relay")} & used


@only_nightly()
def test_player_and_monitor_share_a_process_apart_from_the_graph(bench: Bench) -> None:
    done = bench.run(relay_spec(harness=IN_ONE))
    done.assert_complete()
    record = done.run().record
    assert sorted((process.name, process.exit_code) for process in record.processes) == [
        ("harness", 0),
        ("harness.observer", 0),
        ("relay", 0),
    ]
    (segment,) = done.segments()
    assert done.run().monitor(segment, "out").size == 20


@only_nightly()
def test_a_node_that_fails_beside_the_harness_is_named(bench: Bench) -> None:
    bench.write_node("fails.py", FAILS)
    graph = {"placement": "harness", "nodes": {"fails": {"python": "./fails.py:Fails"}}}
    done = bench.run(relay_spec(graph=graph))
    assert done.status == 4
    assert "R2B634" in done.error
    assert "a callback of /r2b/fails raised RuntimeError: lost the plot" in done.error


@only_nightly()
def test_a_harness_that_is_killed_is_named(bench: Bench) -> None:
    spec = relay_spec(harness=IN_ONE)
    spec["benchmark"]["duration"] = "30 s"
    with bench.start(spec) as running:
        running.wait_for("iteration 1")
        running.child("harness").kill()
        done = running.finish()
    assert done.status == 4
    assert "process harness was killed by SIGKILL" in done.error
    assert done.run().record.status == "incomplete"
