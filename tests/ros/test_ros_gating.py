"""What makes a verdict one that can be trusted, on real ROS 2."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from machine_load import skip_for_load
from ros_runs import Bench, Finished, relay_node, relay_spec
from ros_runs import nothing_left as nothing_left

# The busy wait of the relay alone takes longer, on any machine.
IMPOSSIBLE = {"impossible": {"at": "8 Hz", "require": ["latency.max < 2 ms"]}}
SPEC = relay_spec(
    graph={"nodes": {"relay": relay_node(10.0)}},
    benchmark={
        "duration": "1 s",
        "iterations": 1,
        "rates": ["8 Hz"],
        "warm_up": "100 ms",
        "start_timeout": "60 s",
    },
)


TOLERANT = {"interference": "tolerate"}
"""What else the machine does is not the subject here."""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    return Bench(tmp_path_factory.mktemp("gating"))


def run_that_fails(bench: Bench, **gate: Any) -> Finished:
    """A run whose only requirement cannot hold, on a machine that keeps the schedule."""
    spec = SPEC | {"slos": IMPOSSIBLE, "benchmark": SPEC["benchmark"] | {"gate": gate | TOLERANT}}
    for _ in range(3):
        done = bench.run(spec)
        if done.outcome != "invalid":
            return done
    return skip_for_load("play 8 messages a second on time")


def test_a_failure_is_confirmed_by_a_fresh_batch_in_fresh_processes(bench: Bench) -> None:
    done = run_that_fails(bench)
    record = done.run().record
    # On a busy machine the fresh iteration may have been played again, which is no other one.
    kinds = [each.kind for each in record.segments if not each.rerun_of]
    assert kinds.count("iteration") == kinds.count("confirmation") == 1
    (fresh,) = (
        each for each in record.segments if each.kind == "confirmation" and not each.rerun_of
    )
    assert fresh.id == "confirm-rate-8Hz-001"
    # Each process of the graph ran twice, and ended twice.
    pids = {(each.name, each.pid) for each in record.processes}
    names = [each.name for each in record.processes]
    assert len(pids) == len(names) == 2 * len(set(names))
    assert all(each.exit_code is not None for each in record.processes)
    # A disturbance may make the fresh batch unusable; then it says so, and nothing fails.
    assert done.outcome in {"fail", "inconclusive"}
    if done.outcome == "fail":
        assert done.status == 1
        assert "Confirmed by a second run in new processes." in " ".join(done.stdout.split())
    again = bench.judge(done.folder, "--format", "json")
    assert again.stdout.encode() == (Path(done.folder) / "result.json").read_bytes()
    # What else happened on the machine stands beside every iteration, and cost none of them.
    (rate,) = done.result()["metrics"]["rates"]
    assert all(each["interference"]["seconds"] > 0 for each in rate["iterations"])
    assert done.run().interference().size > 2


def test_what_a_time_budget_does_not_allow_is_left_out_and_told(bench: Bench) -> None:
    # Bringing a batch up takes longer than that, on any machine.
    done = run_that_fails(bench, time_budget="1200 ms")
    assert (done.status, done.outcome) == (1, "fail")
    assert done.run().record.confirmation is None
    assert "No confirmation run: it would exceed the time budget of 1.2 s." in " ".join(
        done.stdout.split()
    )
