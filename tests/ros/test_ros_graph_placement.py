"""``harness: {placement: graph}``: player and monitors inside the processes of the graph."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from c_nodes import c_node, c_node_spec
from ros_runs import IMAGE, Bench, Finished, relay_node, relay_spec
from ros_runs import nothing_left as nothing_left

GRAPH: dict[str, Any] = {"placement": "graph"}
STEPS = 20
"""Of the one iteration of `relay_spec`."""

MEASURED = {"buffer": 5, "inputs": {"input": {"from": "loaded", "format": IMAGE}}}
"""An input that has a floor, unlike that of `relay_spec`."""

FOREIGN_USER = 65534


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path / "bench")


def c_relay(**changes: Any) -> dict[str, Any]:
    return {"nodes": {"node": c_node_spec("relay", **changes)}}


def assert_every_message_matched(done: Finished, monitor: str = "out", steps: int = STEPS) -> None:
    done.assert_complete()
    (rate,) = done.result()["metrics"]["rates"]
    out = rate["pooled"]["monitors"][monitor]
    assert (out["received"], out["answered"], out["missed"]) == (steps, steps, 0), out


def processes(done: Finished) -> list[tuple[str, str, int | None]]:
    return [(each.name, each.role, each.exit_code) for each in done.run().record.processes]


def test_a_python_node_has_the_harness_in_its_process(bench: Bench) -> None:
    done = bench.run(relay_spec(harness=GRAPH, playback=MEASURED))
    assert_every_message_matched(done)
    # The overhead is measured before the graph starts, in a process of its own.
    assert processes(done) == [
        ("harness", "harness", 0),
        ("harness.observer", "observer", 0),
        ("relay", "host", 0),
    ]
    (overhead,) = done.run().record.harness_overhead
    assert (overhead.placement, overhead.processes, overhead.received) == (
        "graph",
        1,
        overhead.sent,
    )
    assert "latency without the graph, within one process" in done.stdout


def test_a_program_in_c_keeps_its_arguments_and_its_end(bench: Bench) -> None:
    done = bench.run(relay_spec(harness=GRAPH, graph=c_relay(parameters={"service_time_ms": 2.5})))
    assert_every_message_matched(done)
    assert processes(done) == [("harness.observer", "observer", 0), ("node", "command", 0)]
    (node,) = [each for each in done.run().record.processes if each.name == "node"]
    assert node.signals == (signal.SIGINT,)
    (rate,) = done.result()["metrics"]["rates"]
    assert rate["pooled"]["monitors"]["out"]["latency"]["min"] >= 0.0025


def test_player_and_monitors_run_where_their_topics_are(bench: Bench) -> None:
    first = relay_node(remappings={"output": "middle"})
    second = c_node_spec("relay", remappings={"input": "middle"})
    monitors = {
        "middle": {"topic": "middle", "format": IMAGE},
        "out": {"topic": "output", "format": IMAGE, "taps": True},
    }
    graph = {"nodes": {"first": first, "second": second}}
    done = bench.run(relay_spec(harness=GRAPH, graph=graph, monitors=monitors))
    for monitor in monitors:
        assert_every_message_matched(done, monitor)
    assert [name for name, _, _ in processes(done)] == ["harness.observer", "first", "second"]


@only_nightly()
def test_every_start_joins_fresh_processes(bench: Bench) -> None:
    first = relay_node(remappings={"output": "middle"})
    second = c_node_spec("relay", remappings={"input": "middle"})
    spec = relay_spec(harness=GRAPH, graph={"nodes": {"first": first, "second": second}})
    spec["benchmark"] |= {"starts": 2, "iterations": 4, "duration": "250 ms"}
    done = bench.run(spec)
    assert_every_message_matched(done, steps=4 * 5)
    names = Counter(name for name, _, _ in processes(done))
    assert names == {"harness.observer": 2, "first": 2, "second": 2}
    joined = {each.name: each.parts for each in done.run().record.processes if each.parts}
    assert joined == {"first": ("player",), "second": ("monitor",)}
    assert "Process first contains the player of the harness" in done.stdout


@only_nightly()
def test_a_wrapper_hands_the_harness_on_to_the_node(bench: Bench) -> None:
    wrapped = [sys.executable, "-c", WRAPPER, str(c_node("relay"))]
    done = bench.run(relay_spec(harness=GRAPH, graph=c_relay(command=wrapped)))
    assert_every_message_matched(done)
    # Neither the node nor what it starts later asks again.
    assert "R2BSPEC_JOIN_SOCKET" in done.log("node")


WRAPPER = """
import os, subprocess, sys
print("handed on:", *(name for name in sorted(os.environ) if name.startswith("R2BSPEC_JOIN")))
sys.exit(subprocess.call(sys.argv[1:]))
"""


def test_of_several_nodes_of_a_script_the_one_that_is_named_is_joined(bench: Bench) -> None:
    script = bench.folder / "two.sh"
    script.write_text(TWO_NODES)
    command = ["sh", str(script), str(c_node("relay"))]
    monitors = {"out": {"topic": "output", "format": IMAGE, "in": "node/meant"}}
    done = bench.run(
        relay_spec(harness=GRAPH | {"in": "node/meant"}, graph=c_relay(command=command))
        | {"monitors": monitors}
    )
    assert_every_message_matched(done)
    (node,) = [each for each in done.run().record.processes if each.name == "node"]
    assert node.parts == ("player", "monitor")


TWO_NODES = """
relay=$1
shift
"$relay" --ros-args -r __ns:=/r2b -r __node:=other -r input:=neither -r output:=nor &
exec "$relay" "$@" -r __node:=meant
"""


def test_what_a_node_starts_does_not_inherit_the_harness(bench: Bench) -> None:
    bench.write_node("starts.py", STARTS)
    graph = {"nodes": {"starts": {"python": "./starts.py:Starts"}}}
    done = bench.run(relay_spec(harness=GRAPH | {"in": "starts"}, graph=graph, monitors=IN_STARTS))
    assert_every_message_matched(done)
    assert "inherited: []" in done.log("starts")


IN_STARTS = {"out": {"topic": "output", "format": IMAGE, "in": "starts"}}
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


def test_a_crash_of_the_graph_is_named_and_loses_nothing(bench: Bench) -> None:
    warm_up, further = 10, 5
    crash = c_node_spec("crash", parameters={"messages": warm_up + further})
    done = bench.run(relay_spec(harness=GRAPH, graph={"nodes": {"node": crash}}))
    assert done.status == 4
    assert "process node was killed by SIGSEGV" in done.error
    run = done.run()
    assert run.record.status == "incomplete"
    (node,) = [each for each in run.record.processes if each.name == "node"]
    assert (node.exit_code, node.signals) == (-signal.SIGSEGV, ())
    (segment,) = [each for each in run.record.segments if each.kind == "iteration"]
    assert not segment.complete
    # What came before the crash is in the file; the last answer may have died with its reader.
    assert run.monitor(segment, "out").size in {further - 1, further}


@only_nightly()
def test_a_static_program_is_refused_before_anything_is_measured(bench: Bench) -> None:
    source, program = bench.folder / "static.c", bench.folder / "static"
    source.write_text("int main(void) { return 0; }\n")
    compiler = shutil.which("cc") or pytest.skip("there is no C compiler")
    made = subprocess.run(
        [compiler, "-static", "-o", str(program), str(source)], capture_output=True, check=False
    )
    if made.returncode:
        pytest.skip(f"no static program can be linked here: {made.stderr.decode()[-200:]}")
    done = bench.run(relay_spec(harness=GRAPH, graph=c_relay(command=[str(program)])))
    assert_refused(done, f"{program} is linked statically")


@only_nightly()
@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a program to another user")
def test_a_setuid_program_is_refused_before_anything_is_measured(bench: Bench) -> None:
    program = bench.folder / "setuid"
    program.write_bytes(c_node("relay").read_bytes())
    os.chown(program, FOREIGN_USER, FOREIGN_USER)
    program.chmod(0o4755)
    done = bench.run(relay_spec(harness=GRAPH, graph=c_relay(command=[str(program)])))
    assert_refused(done, f"{program} runs as another user (setuid or setgid)")


@only_nightly()
def test_a_program_that_is_no_node_is_refused_at_the_deadline(bench: Bench) -> None:
    idle = [sys.executable, "-c", "import signal; signal.pause()"]
    spec = relay_spec(harness=GRAPH, graph=c_relay(command=idle))
    spec["benchmark"] |= {"start_timeout": "2 s"}
    assert_refused(bench.run(spec), "none of its programs has initialised ROS")


def test_idle_programs_that_have_not_loaded_ros_are_not_waited_for_until_the_deadline(
    bench: Bench,
) -> None:
    script = bench.folder / "idle.sh"
    script.write_text("sleep 1000\n")
    spec = relay_spec(harness=GRAPH, graph=c_relay(command=["sh", str(script)]))
    # It is idle after a third of this time.
    spec["benchmark"] |= {"start_timeout": "30 s"}
    assert_refused(bench.run(spec), "none of its programs has loaded ROS, and they have been idle")


def assert_refused(done: Finished, reason: str) -> None:
    assert done.status == 2, done.stderr
    assert "R2B674" in done.error
    assert f"player and monitors cannot join process node: {reason}" in done.error
    assert not done.run().record.segments
