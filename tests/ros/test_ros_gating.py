"""What makes a verdict one that can be trusted, on real ROS 2."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from ros_runs import Bench, relay_node, relay_spec
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


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    return Bench(tmp_path_factory.mktemp("gating"))


def test_a_failure_is_confirmed_by_a_fresh_batch_in_fresh_processes(bench: Bench) -> None:
    for _ in range(3):
        done = bench.run(SPEC | {"slos": IMPOSSIBLE})
        if done.outcome != "invalid":
            break
    else:
        pytest.skip("this machine is too loaded to play 8 messages a second on time")
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
        assert "confirmed it." in done.stdout
    again = bench.judge(done.folder, "--format", "json")
    assert again.stdout.encode() == (Path(done.folder) / "result.json").read_bytes()
