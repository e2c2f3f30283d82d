"""A run is a sample of starts: each has fresh processes and its part of the iterations."""

from __future__ import annotations

from typing import Any

import pytest

from nightly import only_nightly, size
from r2bspec.errors import ExitStatus

pytest.importorskip("rclpy")

from ros_runs import IMAGE, MEASURED, Bench, Finished, relay_spec
from ros_runs import bench as bench

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
ITERATIONS = 5
PROCESSES = ("relay", "harness.observer", "player", "monitor")


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
    used["benchmark"] |= {"duration": "250 ms", "iterations": iterations, "starts": starts}
    return used


@pytest.fixture(scope="module")
def done(bench: Bench) -> Finished:
    """Three starts."""
    used = spec("starts.txt", iterations=ITERATIONS, starts=3, playback=MEASURED)
    finished = bench.run(used)
    finished.assert_complete()
    return finished


def starts_of(done: Finished, kind: str) -> list[tuple[str, int]]:
    """The segments of a kind with their starts; reruns are no iterations of their own."""
    return [(segment.id, segment.start) for segment in done.segments(kind) if not segment.rerun_of]


def pids(done: Finished, name: str) -> list[int]:
    return [process.pid for process in done.run().record.processes if process.name == name]


# The starts


def test_each_start_has_fresh_processes_and_its_part_of_the_iterations(done: Finished) -> None:
    assert starts_of(done, "iteration") == [
        (f"rate-20Hz-{number:03d}", start) for number, start in enumerate((1, 1, 2, 2, 3), start=1)
    ]
    # Each start warms up, once or more often, under an id of its own.
    warmed = starts_of(done, "warm_up")
    assert len(set(warmed)) == len(warmed)
    assert {start for _, start in warmed} == {1, 2, 3}
    # Those that import ROS are started before the player.
    names = [process.name for process in done.run().record.processes]
    assert names[:4] == [*PROCESSES]
    assert sorted(names) == sorted(3 * PROCESSES)
    assert len({process.pid for process in done.run().record.processes}) == 3 * len(PROCESSES)
    # The node itself says so, in one log.
    said = [line for line in done.log("relay").splitlines() if line.startswith("start ")]
    assert said == [
        f"start {number} has pid {pid}" for number, pid in enumerate(pids(done, "relay"), start=1)
    ]


def test_a_start_is_complete_before_its_first_iteration(done: Finished) -> None:
    record = done.run().record
    assert [(each.number, each.confirms) for each in record.starts] == [
        (number, False) for number in (1, 2, 3)
    ]
    for start in record.starts:
        own = [segment for segment in record.segments if segment.start == start.number]
        assert all(start.began_ns < each.began_ns for each in own)
        assert all(start.ready_ns < each.began_ns for each in own if each.kind == "iteration")
    # What does not depend on the processes is done once.
    assert done.events().count("phase load") == 1
    # All steps of all starts were answered, and none by an earlier start.
    (rate,) = done.result()["metrics"]["rates"]
    answered = [each["monitors"]["out"]["values"]["answered"] for each in rate["iterations"]]
    assert answered == [5] * ITERATIONS


# What goes wrong in a later start


def test_a_node_that_exits_in_a_later_start_leaves_what_was_measured(bench: Bench) -> None:
    done = bench.run(spec("fatal.txt", iterations=6, starts=3, parameters={"fatal_start": 2}))
    assert done.status == ExitStatus.RUN_FAILED
    assert "process relay exited with status 9" in done.error
    assert "(in start 2)" in done.error
    record = done.run().record
    assert record.status == "incomplete"
    assert "(in start 2)" in record.reason
    assert starts_of(done, "iteration") == [("rate-20Hz-001", 1), ("rate-20Hz-002", 1)]
    # The second start was never ready.
    assert [start.number for start in record.starts] == [1]


# Confirmation


def run_that_fails(bench: Bench, name: str, **gate: Any) -> Finished:
    """A run whose only requirement cannot be met, at a rate that a busy machine keeps, too."""
    used = spec(f"{name}.txt", iterations=2 * STARTS, starts=STARTS)
    used["benchmark"]["gate"] |= gate
    used["benchmark"] |= {"rates": ["2 Hz"], "duration": "1 s"}
    used["slos"] = {"impossible": {"at": "2 Hz", "require": ["latency.max < 1 us"]}}
    return bench.run_until_valid(used)


STARTS = size(1, 3)


def test_a_failure_is_confirmed_by_as_many_fresh_starts(bench: Bench) -> None:
    done = run_that_fails(bench, "confirm")
    starts = [start for start in range(1, STARTS + 1) for _ in range(2)]
    assert starts_of(done, "iteration") == [
        (f"rate-2Hz-{number:03d}", start) for number, start in enumerate(starts, start=1)
    ]
    assert starts_of(done, "confirmation") == [
        (f"confirm-rate-2Hz-{number:03d}", STARTS + start)
        for number, start in enumerate(starts, start=1)
    ]
    record = done.run().record
    assert [start.confirms for start in record.starts] == STARTS * [False] + STARTS * [True]
    assert len(set(pids(done, "relay"))) == 2 * STARTS
    assert all(process.exit_code is not None for process in record.processes)
    # A disturbance may make the fresh batch unusable; then it says so, and nothing fails.
    assert done.outcome in {"fail", "inconclusive"}
    if done.outcome == "fail":
        assert done.status == 1
        assert "Confirmed by a second run in new processes." in done.words
    again = bench.judge(done.folder, "--format", "json")
    assert again.stdout.encode() == (done.folder / "result.json").read_bytes()
    # What else happened on the machine stands beside every iteration, and cost none of them.
    (rate,) = done.result()["metrics"]["rates"]
    assert all(each["interference"]["seconds"] > 0 for each in rate["iterations"])
    assert done.run().interference().size > 2


@only_nightly()
def test_what_a_time_budget_does_not_allow_is_left_out_and_told(bench: Bench) -> None:
    # Bringing a batch up takes longer than that, on any machine.
    done = run_that_fails(bench, "budget", time_budget="1200 ms")
    assert (done.status, done.outcome) == (1, "fail")
    assert done.run().record.confirmation is None
    assert "No confirmation run: it would exceed the time budget of 1.2 s." in done.words
