"""Nodes that are not Python: programs in C on rcl, as `command` nodes."""

from __future__ import annotations

import re
import signal
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from c_nodes import build_c_nodes
from ros_runs import IMAGE, Bench, Finished, relay_spec
from ros_runs import nothing_left as nothing_left

STEPS = 20
"""Of the one iteration of `relay_spec`."""


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return build_c_nodes(tmp_path_factory.mktemp("nodes_c"))


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path / "bench")


def command_node(program: Path, **changes: Any) -> dict[str, Any]:
    node: dict[str, Any] = {
        "command": [str(program)],
        "subscribes": {"input": IMAGE},
        "publishes": {"output": IMAGE},
    }
    return node | changes


def spec_of(program: Path, **changes: Any) -> dict[str, Any]:
    """One node; its queue outlasts long hiccups of the machine."""
    parameters = {"queue_depth": 100} | changes.pop("parameters", {})
    node = command_node(program, parameters=parameters, **changes)
    return relay_spec(graph={"nodes": {"node": node}})


def assert_every_message_matched(done: Finished) -> None:
    done.assert_complete()
    (rate,) = done.result()["metrics"]["rates"]
    out = rate["pooled"]["monitors"]["out"]
    assert (out["received"], out["answered"], out["missed"]) == (STEPS, STEPS, 0), out


def test_names_and_parameters_reach_the_nodes_as_ros_arguments(
    bench: Bench, programs: dict[str, Path]
) -> None:
    relay = command_node(
        programs["relay"],
        parameters={"service_time_ms": 2.5, "queue_depth": 100},
        remappings={"output": "middle"},
    )
    threads = command_node(
        programs["two_threads"],
        parameters={"queue_depth": 100},
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


def test_a_crash_is_named_by_its_signal_and_loses_nothing(
    bench: Bench, programs: dict[str, Path]
) -> None:
    warm_up, further = 10, 5
    spec = spec_of(programs["crash"], parameters={"messages": warm_up + further})
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
def test_nothing_is_played_before_a_late_node_is_ready(
    bench: Bench, programs: dict[str, Path], probe: dict[str, Any]
) -> None:
    spec = spec_of(programs["late"], parameters={"load_time_ms": 1500})
    done = bench.run(spec | {"ready": probe})
    assert_every_message_matched(done)
    found = re.search(r"the model is loaded at (\d+) ns", done.log("node"))
    assert found
    assert int(found[1]) < min(each.began_ns for each in done.run().record.segments)
