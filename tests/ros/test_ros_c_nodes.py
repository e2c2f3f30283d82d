"""Nodes that are not Python: programs in C on rcl, as `command` nodes."""

from __future__ import annotations

import re
import signal

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from c_nodes import c_node_spec
from r2bspec.record.run_record import Segment
from ros_runs import Bench, relay_spec
from ros_runs import bench as bench

STEPS = 20
"""Of the one iteration of `relay_spec`."""


def test_programs_get_their_arguments_and_are_waited_for(bench: Bench) -> None:
    relay = c_node_spec(
        "relay", parameters={"service_time_ms": 2.5}, remappings={"output": "middle"}
    )
    threads = c_node_spec(
        "two_threads",
        namespace="inner",
        remappings={"input": "/r2b/middle", "output": "/r2b/more"},
    )
    late = c_node_spec("late", parameters={"load_time_ms": 1500}, remappings={"input": "more"})
    spec = relay_spec(graph={"nodes": {"relay": relay, "threads": threads, "late": late}})
    done = bench.run(spec | {"ready": {"model": {"log": {"process": "late", "pattern": "loaded"}}}})
    done.assert_counts(STEPS)
    # The shortest latency is no matter of the machine: the relay computes for that long.
    assert done.monitor()["latency"]["min"] >= 0.0025
    nodes = [process for process in done.run().record.processes if process.role == "command"]
    assert {(node.name, node.exit_code, node.signals) for node in nodes} == {
        (name, 0, (signal.SIGINT,)) for name in ("relay", "threads", "late")
    }
    assert_nothing_was_played_before_it_was_loaded(done.log("late"), done.run().record.segments)


@only_nightly()
def test_nothing_is_played_before_a_late_node_is_ready(bench: Bench) -> None:
    """Without a probe, too."""
    late = c_node_spec("late", parameters={"load_time_ms": 1500})
    done = bench.run(relay_spec(graph={"nodes": {"late": late}}))
    done.assert_counts(STEPS)
    assert_nothing_was_played_before_it_was_loaded(done.log("late"), done.run().record.segments)


def assert_nothing_was_played_before_it_was_loaded(log: str, segments: tuple[Segment, ...]) -> None:
    found = re.search(r"the model is loaded at (\d+) ns", log)
    assert found
    assert int(found[1]) < min(segment.began_ns for segment in segments)


def test_a_crash_is_named_by_its_signal_and_loses_nothing(bench: Bench) -> None:
    warm_up, further = 10, 5
    crash = c_node_spec("crash", parameters={"messages": warm_up + further})
    done = bench.run(relay_spec(graph={"nodes": {"node": crash}}))
    assert done.status == 4
    assert "process node was killed by SIGSEGV" in done.error
    run = done.run()
    assert run.record.status == "incomplete"
    (node,) = [process for process in run.record.processes if process.name == "node"]
    assert (node.exit_code, node.signals) == (-signal.SIGSEGV, ())
    (segment,) = done.segments()
    assert not segment.complete
    assert run.monitor(segment, "out").size == further
