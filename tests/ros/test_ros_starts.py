"""A run is a sample of starts: each has fresh processes and its part of the iterations."""

from __future__ import annotations

import signal
from typing import Any

import pytest

from r2bspec.exit_status import ExitStatus

pytest.importorskip("rclpy")

from machine_load import skip_for_load
from ros_runs import IMAGE, Bench, Finished, relay_spec
from ros_runs import nothing_left as nothing_left

NODES = '''
import os
from pathlib import Path


class Relay(Node):
    """Says its pid, and exits at the first message of the start of this number."""

    def __init__(self, **kwargs):
        super().__init__("relay", **kwargs)
        self.fatal = self.declare_parameter("fatal_start", 0).value
        counted = Path(self.declare_parameter("counter", "starts.txt").value)
        self.start = int(counted.read_text()) + 1 if counted.exists() else 1
        counted.write_text(str(self.start))
        print(f"start {self.start} has pid {os.getpid()}", flush=True)
        self.out = self.create_publisher(Image, "output", 100)
        self.create_subscription(Image, "input", self.answer, 100)

    def answer(self, message):
        if self.start == self.fatal:
            os._exit(9)
        self.out.publish(message)
'''


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    made = Bench(tmp_path_factory.mktemp("starts"))
    made.write_node("nodes.py", NODES)
    return made


def spec(counter: str, *, iterations: int, starts: int, **changes: Any) -> dict[str, Any]:
    """A relay that counts its starts in a file of this name."""
    parameters = {"counter": counter} | changes.pop("parameters", {})
    endpoints = {"publishes": {"output": IMAGE}, "subscribes": {"input": IMAGE}}
    relay = {"python": "./nodes.py:Relay", "parameters": parameters} | endpoints
    used = relay_spec(
        graph={"nodes": {"relay": relay}},
        ready={"up": {"log": {"process": "relay", "pattern": "has pid"}}},
        **changes,
    )
    used["benchmark"] |= {"duration": "500 ms", "iterations": iterations, "starts": starts}
    return used


def starts_of(done: Finished, kind: str) -> list[tuple[str, int]]:
    """The segments of a kind with their starts; reruns are no iterations of their own."""
    return [
        (each.id, each.start)
        for each in done.run().record.segments
        if each.kind == kind and not each.rerun_of
    ]


def pids(done: Finished, name: str) -> list[int]:
    return [each.pid for each in done.run().record.processes if each.name == name]


def test_each_start_has_fresh_processes_and_its_part_of_the_iterations(bench: Bench) -> None:
    done = bench.run(spec("three.txt", iterations=7, starts=3))
    done.assert_complete()
    starts = [1, 1, 1, 2, 2, 3, 3]
    assert starts_of(done, "iteration") == [
        (f"rate-20Hz-{number:03d}", start) for number, start in enumerate(starts, start=1)
    ]
    # Each start warms up, once or more often, under an id of its own.
    warmed = starts_of(done, "warm_up")
    assert len(set(warmed)) == len(warmed)
    assert {start for _, start in warmed} == {1, 2, 3}
    for name in ("player", "monitor", "relay"):
        assert len(set(pids(done, name))) == len(pids(done, name)) == 3
    # The node itself says so, in one log.
    said = [line for line in done.log("relay").splitlines() if line.startswith("start ")]
    assert said == [
        f"start {number} has pid {pid}" for number, pid in enumerate(pids(done, "relay"), start=1)
    ]
    record = done.run().record
    assert [each.number for each in record.starts] == [1, 2, 3]
    assert not any(each.confirms for each in record.starts)
    # Others can have had a part of the time of each, and no more.
    assert all(
        0.0 <= each.taken <= 1.0 and bool(each.disturbed) >= bool(each.taken)
        for each in record.starts
    )
    # What does not depend on the processes is done once.
    for phase in ("load", "harness_overhead"):
        assert done.events().count(f"phase {phase}") == 1
    # A start is complete before its first iteration, and its processes end before the next.
    for each in record.starts:
        own = [one for one in record.segments if one.start == each.number]
        assert all(each.began_ns < one.began_ns for one in own)
        assert all(each.ready_ns < one.began_ns for one in own if one.kind == "iteration")
    # All steps of all starts were answered, and none by an earlier start.
    (rate,) = done.result()["metrics"]["rates"]
    assert [each["monitors"]["out"]["answered"] for each in rate["iterations"]] == [10] * 7


def test_a_node_that_exits_in_a_later_start_leaves_what_was_measured(bench: Bench) -> None:
    used = spec("fatal.txt", iterations=4, starts=2, parameters={"fatal_start": 2})
    done = bench.run(used)
    assert done.status == ExitStatus.RUN_FAILED
    assert "process relay exited with status 9" in done.error
    assert "(in start 2)" in done.error
    record = done.run().record
    assert record.status == "incomplete"
    assert "(in start 2)" in record.reason
    assert starts_of(done, "iteration") == [("rate-20Hz-001", 1), ("rate-20Hz-002", 1)]
    # The second start was never ready.
    assert [each.number for each in record.starts] == [1]


def test_an_interrupt_between_two_starts_leaves_what_was_measured(bench: Bench) -> None:
    with bench.start(spec("interrupted.txt", iterations=6, starts=3)) as running:
        running.wait_for("start 2")
        running.process.send_signal(signal.SIGINT)
        done = running.finish()
    assert done.status == ExitStatus.INTERRUPTED
    assert starts_of(done, "iteration")[:2] == [("rate-20Hz-001", 1), ("rate-20Hz-002", 1)]
    assert done.run().record.status == "incomplete"


def run_that_fails(bench: Bench) -> Finished:
    """A run whose only requirement cannot be met, on a machine that keeps the schedule."""
    for attempt in range(3):
        used = spec(f"confirm{attempt}.txt", iterations=4, starts=2)
        used["slos"] = {"impossible": {"at": "20 Hz", "require": ["latency.max < 1 us"]}}
        done = bench.run(used)
        if done.outcome != "invalid":
            return done
    return skip_for_load("play 20 messages a second on time")


def test_a_failure_is_confirmed_by_as_many_fresh_starts(bench: Bench) -> None:
    done = run_that_fails(bench)
    assert starts_of(done, "iteration") == [
        ("rate-20Hz-001", 1),
        ("rate-20Hz-002", 1),
        ("rate-20Hz-003", 2),
        ("rate-20Hz-004", 2),
    ]
    assert starts_of(done, "confirmation") == [
        ("confirm-rate-20Hz-001", 3),
        ("confirm-rate-20Hz-002", 3),
        ("confirm-rate-20Hz-003", 4),
        ("confirm-rate-20Hz-004", 4),
    ]
    record = done.run().record
    assert [each.confirms for each in record.starts] == [False, False, True, True]
    # The harness of the confirmation is compared with that of the run, once.
    assert done.events().count("phase harness_overhead") == 2
    assert len(set(pids(done, "relay"))) == 4
    assert all(each.exit_code is not None for each in record.processes)
