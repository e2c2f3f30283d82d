"""Nodes that are not Python: programs in C on rcl, as `command` nodes."""

from __future__ import annotations

import re
import signal
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from c_nodes import c_node_spec
from ros_runs import Bench, Finished, relay_spec
from ros_runs import nothing_left as nothing_left

STEPS = 20
"""Of the one iteration of `relay_spec`."""


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path / "bench")


def spec_of(name: str, **parameters: Any) -> dict[str, Any]:
    return relay_spec(graph={"nodes": {"node": c_node_spec(name, parameters=parameters)}})


def assert_every_message_matched(done: Finished) -> None:
    done.assert_complete()
    (rate,) = done.result()["metrics"]["rates"]
    out = rate["pooled"]["monitors"]["out"]
    assert (out["received"], out["answered"], out["missed"]) == (STEPS, STEPS, 0), out


def test_names_and_parameters_reach_the_nodes_as_ros_arguments(bench: Bench) -> None:
    relay = c_node_spec(
        "relay", parameters={"service_time_ms": 2.5}, remappings={"output": "middle"}
    )
    threads = c_node_spec(
        "two_threads",
        namespace="inner",
        remappings={"input": "/r2b/middle", "output": "/r2b/output"},
    )
    done = bench.run(relay_spec(graph={"nodes": {"relay": relay, "threads": threads}}))
    assert_every_message_matched(done)
    (rate,) = done.result()["metrics"]["rates"]
    # The shortest latency is no matter of the machine: the relay computes for that long.
    assert rate["pooled"]["monitors"]["out"]["latency"]["min"] >= 0.0025
    nodes = [each for each in done.run().record.processes if each.role == "command"]
    assert [(each.name, each.exit_code, each.signals) for each in nodes] == [
        ("relay", 0, (signal.SIGINT,)),
        ("threads", 0, (signal.SIGINT,)),
    ]


def test_a_crash_is_named_by_its_signal_and_loses_nothing(bench: Bench) -> None:
    warm_up, further = 10, 5
    spec = spec_of("crash", messages=warm_up + further)
    done = bench.run(spec)
    assert done.status == 4
    assert "process node was killed by SIGSEGV" in done.error
    run = done.run()
    assert run.record.status == "incomplete"
    (node,) = [each for each in run.record.processes if each.name == "node"]
    assert (node.exit_code, node.signals) == (-signal.SIGSEGV, ())
    (segment,) = [each for each in run.record.segments if each.kind == "iteration"]
    assert not segment.complete
    assert run.monitor(segment, "out").size == further


@pytest.mark.parametrize(
    "probe", [{}, {"model": {"log": {"process": "node", "pattern": "is loaded"}}}]
)
def test_nothing_is_played_before_a_late_node_is_ready(bench: Bench, probe: dict[str, Any]) -> None:
    spec = spec_of("late", load_time_ms=1500)
    done = bench.run(spec | {"ready": probe})
    assert_every_message_matched(done)
    found = re.search(r"the model is loaded at (\d+) ns", done.log("node"))
    assert found
    assert int(found[1]) < min(each.began_ns for each in done.run().record.segments)
