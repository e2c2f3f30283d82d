"""``harness: {placement: graph}``: player and monitors inside the processes of the graph."""

from __future__ import annotations

import signal
import sys
from collections import Counter
from typing import Any

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from c_nodes import c_node, c_node_spec
from r2bspec.record.run_record import ProcessRecord
from ros_runs import IMAGE, Bench, Finished, relay_node, relay_spec
from ros_runs import bench as bench

GRAPH: dict[str, Any] = {"placement": "graph"}
STEPS = 20
"""Of the one iteration of `relay_spec`."""

STARTS = """
import subprocess, sys
LIST = (
    "import os; print('inherited:', [each for each in os.environ"
    " if each == 'LD_PRELOAD' or each.startswith('R2BSPEC_JOIN')])"
)
class Starts(Node):
    def __init__(self, **kwargs):
        super().__init__("starts", **kwargs)
        print(subprocess.check_output([sys.executable, "-c", LIST], text=True), flush=True)
        self.out = self.create_publisher(Image, "output", 100)
        self.create_subscription(Image, "input", self.out.publish, 100)
"""


def c_relay(**changes: Any) -> dict[str, Any]:
    return {"nodes": {"node": c_node_spec("relay", **changes)}}


def process(done: Finished, name: str) -> ProcessRecord:
    (found,) = [listed for listed in done.run().record.processes if listed.name == name]
    return found


def test_player_and_monitors_run_where_their_topics_are(bench: Bench) -> None:
    """In a Python node, which starts a program, and in a program in C behind it."""
    bench.write_node("starts.py", STARTS)
    first = {
        "python": "./starts.py:Starts",
        "remappings": {"output": "middle"},
        "subscribes": {"input": IMAGE},
        "publishes": {"output": IMAGE},
    }
    second = c_node_spec(
        "relay", remappings={"input": "middle"}, parameters={"service_time_ms": 2.5}
    )
    monitors = {
        "middle": {"topic": "middle", "format": IMAGE},
        "out": {"topic": "output", "format": IMAGE},
    }
    graph = {"nodes": {"first": first, "second": second}}
    done = bench.run(relay_spec(harness=GRAPH, graph=graph, monitors=monitors))
    for monitor in monitors:
        done.assert_counts(STEPS, monitor)
    ended = [(listed.name, listed.role, listed.exit_code) for listed in done.run().record.processes]
    assert ended == [
        ("harness.observer", "observer", 0),
        ("first", "host", 0),
        ("second", "command", 0),
    ]
    # The program has its arguments, and ends as it does alone.
    assert process(done, "second").signals == (signal.SIGINT,)
    assert done.monitor()["latency"]["min"] >= 0.0025
    # What a node starts does not inherit the harness.
    assert "inherited: []" in done.log("first")


@only_nightly()
def test_every_start_joins_fresh_processes(bench: Bench) -> None:
    first = relay_node(remappings={"output": "middle"})
    second = c_node_spec("relay", remappings={"input": "middle"})
    spec = relay_spec(harness=GRAPH, graph={"nodes": {"first": first, "second": second}})
    spec["benchmark"] |= {"starts": 3, "iterations": 6, "duration": "250 ms"}
    done = bench.run(spec)
    done.assert_counts(6 * 5)
    names = Counter(listed.name for listed in done.run().record.processes)
    assert names == {"harness.observer": 3, "first": 3, "second": 3}
    joined = {listed.name: listed.parts for listed in done.run().record.processes if listed.parts}
    assert joined == {"first": ("player",), "second": ("monitor",)}
    assert "Process first contains the player of the harness" in done.stdout


@only_nightly()
def test_a_wrapper_hands_the_harness_on_to_the_node(bench: Bench) -> None:
    wrapped = [sys.executable, "-c", WRAPPER, str(c_node("relay"))]
    done = bench.run(relay_spec(harness=GRAPH, graph=c_relay(command=wrapped)))
    done.assert_counts(STEPS)
    # Neither the node nor what it starts later asks again.
    assert "R2BSPEC_JOIN_SOCKET" in done.log("node")


WRAPPER = """
import os, subprocess, sys
print("handed on:", *(name for name in sorted(os.environ) if name.startswith("R2BSPEC_JOIN")))
sys.exit(subprocess.call(sys.argv[1:]))
"""


def two_programs(bench: Bench) -> list[str]:
    script = bench.folder / "two.sh"
    script.write_text(TWO_NODES)
    return ["sh", str(script), str(c_node("relay"))]


@only_nightly()
def test_of_several_nodes_of_a_script_none_is_joined_that_is_not_named(bench: Bench) -> None:
    done = bench.run(relay_spec(harness=GRAPH, graph=c_relay(command=two_programs(bench))))
    assert_refused(done, "it starts several programs that use ROS: meant, other")
    assert "in: node/meant" in done.error


@only_nightly()
def test_of_several_nodes_of_a_script_the_one_that_is_named_is_joined(bench: Bench) -> None:
    command = two_programs(bench)
    monitors = {"out": {"topic": "output", "format": IMAGE, "in": "node/meant"}}
    done = bench.run(
        relay_spec(harness=GRAPH | {"in": "node/meant"}, graph=c_relay(command=command))
        | {"monitors": monitors}
    )
    done.assert_counts(STEPS)
    assert process(done, "node").parts == ("player", "monitor")


TWO_NODES = """
relay=$1
shift
"$relay" --ros-args -r __ns:=/r2b -r __node:=other -r input:=neither -r output:=nor &
exec "$relay" "$@" -r __node:=meant
"""


@only_nightly()
def test_a_crash_of_the_graph_is_named_and_loses_nothing(bench: Bench) -> None:
    warm_up, further = 10, 5
    crash = c_node_spec("crash", parameters={"messages": warm_up + further})
    done = bench.run(relay_spec(harness=GRAPH, graph={"nodes": {"node": crash}}))
    assert done.status == 4
    assert "process node was killed by SIGSEGV" in done.error
    run = done.run()
    assert run.record.status == "incomplete"
    node = process(done, "node")
    assert (node.exit_code, node.signals) == (-signal.SIGSEGV, ())
    (segment,) = done.segments()
    assert not segment.complete
    # What came before the crash is in the file; the last answer may have died with its reader.
    assert run.monitor(segment, "out").size in {further - 1, further}


@only_nightly()
def test_a_program_that_is_no_node_is_refused_at_the_deadline(bench: Bench) -> None:
    idle = [sys.executable, "-c", "import signal; signal.pause()"]
    spec = relay_spec(harness=GRAPH, graph=c_relay(command=idle))
    spec["benchmark"] |= {"start_timeout": "2 s"}
    assert_refused(bench.run(spec), "none of its programs has initialised ROS")


def assert_refused(done: Finished, reason: str) -> None:
    assert done.status == 2, done.stderr
    assert "R2B674" in done.error
    assert f"player and monitors cannot join process node: {reason}" in done.error
    assert not done.run().record.segments
