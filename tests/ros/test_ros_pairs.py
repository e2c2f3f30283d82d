"""Base and head in interleaved runs on real ROS 2."""

from __future__ import annotations

import json
import re
import signal
from pathlib import Path

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from r2bspec.judge.statistics.t_interval import pair_orders
from r2bspec.record.comparison_folder import open_comparison
from ros_runs import Bench, Finished, relay_node, relay_spec
from ros_runs import bench as bench

# The order of pairs is tested with simulated runs (tests/unit/compare), real turns in
# test_ros_turns.py.
pytestmark = only_nightly()

# The base waits for six times as long: nothing fails, so that nothing is played again for that.
RELAY = relay_node()
RELAY["parameters"] |= {"service_time_ms": "$(var ms)"}
SPEC = relay_spec(
    variables={"ms": 5.0},
    graph={"nodes": {"relay": RELAY}},
    benchmark={
        "duration": "2 s",
        "iterations": 1,
        "rates": ["2 Hz"],
        "warm_up": "100 ms",
        "start_timeout": "60 s",
    },
    slos={"no_regression": {"at": "2 Hz", "require": ["latency.p99 <= 100 % of baseline"]}},
)


@pytest.fixture(scope="module")
def compared(bench: Bench) -> Finished:
    """A relay of 5 ms against one of 30 ms, two pairs."""
    return bench.compare(SPEC, "--against", "var:ms=30.0", "--pairs", "2")


def test_runs_are_interleaved_whole_and_fresh(compared: Finished) -> None:
    pairs = open_comparison(compared.folder)
    assert pairs.record.status == "complete"
    orders = tuple(pairing.order for pairing in pairs.record.pairs if not pairing.again)
    assert orders == pair_orders(2, pairs.record.seed)
    assert sorted(orders) == ["AB", "BA"]
    began, pids = [], []
    for pair in pairs.record.pairs:
        for side in ("base", "head") if pair.order == "AB" else ("head", "base"):
            run = pairs.run(pair, side)
            assert run.record.status == "complete"
            began.append(min(segment.began_ns for segment in run.record.segments))
            pids += [process.pid for process in run.record.processes]
            (relay,) = [process for process in run.plan.processes if process.name == "relay"]
            wanted = {"base": 30.0, "head": 5.0}[side]
            assert relay.nodes[0].parameters["service_time_ms"] == wanted
    assert began == sorted(began)
    assert len(set(pids)) == len(pids)


def test_the_verdict_says_what_it_rests_on(compared: Finished) -> None:
    result = json.loads((compared.folder / "result.json").read_text())
    (one,) = result["verdict"]["requirements"]
    assert one["method"] == "paired t on logs"
    # The relay waits, whatever else the machine does.
    assert one["compared"]["base"] > 0.030
    assert one["compared"]["head"] > 0.005
    assert len(one["compared"]["head_values"]) == 2
    assert "Compared with var:ms=30.0" in compared.stdout
    assert "service_time_ms: 30.0 -> 5.0" in compared.words


def test_an_interrupted_comparison_keeps_its_pairs(bench: Bench) -> None:
    with bench.start(SPEC, "--control", "--pairs", "5", verb="compare") as running:
        # A coin decides which side is first.
        running.wait_for(r"(?s)pair 1 of 5: .*pair 1 of 5: .*playing at")
        running.process.send_signal(signal.SIGINT)
        done = running.finish()
    assert done.status == 130
    pairs = open_comparison(done.folder)
    assert pairs.record.status == "incomplete"
    assert pairs.record.reason.startswith("R2B670")
    assert pairs.record.pairs == ()
    assert done.outcome == "incomplete"
    first = re.findall(r"pair 1 of 5: (base|head)", done.stderr)[0]
    kept = json.loads((done.folder / first / "001" / "record.json").read_text())
    assert kept["status"] == "complete"


def test_a_head_that_dies_never_passes(bench: Bench) -> None:
    bench.write_node("dying.py", DYING)
    spec = SPEC | {"graph": {"nodes": {"relay": {"python": "./dying.py:Dying"}}}}
    base = bench.write(SPEC, "base")
    done = bench.compare(spec, "--against", str(base), "--pairs", "1")
    assert (done.status, done.outcome) == (4, "incomplete")
    assert "the head failed" in done.stderr
    assert re.search(r"yaml:\d+:\d+: error\[R2B631[^\n]+relay exited with status 3", done.stderr)
    assert "Its last output:\nno such kernel" in done.stderr
    pairs = open_comparison(done.folder)
    assert pairs.usable_pairs() == ()
    assert (Path(done.folder) / "head" / "001-again" / "record.json").exists()


DYING = """
import os


class Dying(Node):
    def __init__(self, **kwargs):
        super().__init__("relay", **kwargs)
        self.create_subscription(Image, "input", self.die, 10)
        self.create_publisher(Image, "output", 10)

    def die(self, _):
        print("no such kernel", flush=True)
        os._exit(3)
"""
