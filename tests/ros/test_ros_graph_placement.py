"""``harness: {placement: graph}``: player and monitors inside the processes of the graph."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from c_nodes import c_node_spec
from ros_runs import Bench, Finished, relay_spec
from ros_runs import nothing_left as nothing_left

GRAPH: dict[str, Any] = {"placement": "graph"}
STEPS = 20
"""Of the one iteration of `relay_spec`."""


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path / "bench")


def assert_every_message_matched(done: Finished, monitor: str = "out") -> None:
    done.assert_complete()
    (rate,) = done.result()["metrics"]["rates"]
    out = rate["pooled"]["monitors"][monitor]
    assert (out["received"], out["answered"], out["missed"]) == (STEPS, STEPS, 0), out


def processes(done: Finished) -> list[tuple[str, str, int | None]]:
    return [(each.name, each.role, each.exit_code) for each in done.run().record.processes]


def test_a_python_node_has_the_harness_in_its_process(bench: Bench) -> None:
    done = bench.run(relay_spec(harness=GRAPH))
    assert_every_message_matched(done)
    # The overhead is measured before the graph starts, in a process of its own.
    assert processes(done) == [
        ("harness", "harness", 0),
        ("harness.observer", "observer", 0),
        ("relay", "host", 0),
    ]


def test_a_program_in_c_has_the_harness_in_its_process(bench: Bench) -> None:
    done = bench.run(relay_spec(harness=GRAPH, graph={"nodes": {"node": c_node_spec("relay")}}))
    assert_every_message_matched(done)
    assert processes(done)[-1] == ("node", "command", 0)
