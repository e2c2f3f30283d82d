"""Promise: an answer that is late is waited for as long as `drain_timeout` says, and counts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

pytest.importorskip("rclpy")

from ros_runs import Bench, Finished, relay_spec
from ros_runs import nothing_left as nothing_left

NODES = """
import time


class Answers(Node):
    def __init__(self, **kwargs):
        super().__init__("answers", **kwargs)
        self.in_segment, self.last_s, self.paused = 0, 0.0, False
        self.out = self.create_publisher(Image, "output", 200)
        self.create_subscription(Image, "input", self.answer, 200)

    def answer(self, message):
        # Iterations are played at 20 Hz, the warm-up before them at 10 Hz.
        now_s = time.monotonic()
        self.in_segment = self.in_segment + 1 if now_s - self.last_s < 0.075 else 0
        self.last_s = now_s
        self.forward(message)

    def forward(self, message):
        self.out.publish(message)


class PausesOnce(Answers):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.declare_parameter("pause_s", 1.0)

    def forward(self, message):
        if self.in_segment == 12 and not self.paused:
            self.paused = True
            time.sleep(self.get_parameter("pause_s").value)
        self.out.publish(message)


class DropsOne(Answers):
    def forward(self, message):
        if self.in_segment != 5:
            self.out.publish(message)
"""
STEPS = 20


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    found = Bench(tmp_path_factory.mktemp("drain"))
    found.write_node("nodes.py", NODES)
    return found


def run_until(
    expected: Callable[[Finished], bool], bench: Bench, node: str, timeout: str, **parameters: Any
) -> Finished:
    """The first of three runs that is as expected: a busy machine loses messages by itself."""
    for _ in range(3):
        done = run(bench, node, timeout, **parameters)
        if expected(done):
            break
    return done


def run(bench: Bench, node: str, drain_timeout: str, **parameters: Any) -> Finished:
    spec = relay_spec(
        graph={"nodes": {"node": {"python": f"./nodes.py:{node}", "parameters": parameters}}}
    )
    spec["benchmark"] |= {"drain_timeout": drain_timeout, "iterations": 2}
    return bench.run(spec)


def counts(done: Finished) -> list[tuple[int, int]]:
    """Of each iteration, how many steps were played, and how many were answered."""
    (rate,) = done.result()["metrics"]["rates"]
    seen = [each["monitors"]["out"] for each in rate["iterations"]]
    return [(each["sent"], each["sent"] - each["missed"]) for each in seen]


def test_a_graph_that_pauses_for_longer_than_usual_answers_everything(bench: Bench) -> None:
    # The pause begins in the first iteration, after the warm-up, and outlasts its last input.
    everything = [(STEPS, STEPS)] * 2
    done = run_until(
        lambda each: counts(each) == everything, bench, "PausesOnce", "20 s", pause_s=4.0
    )
    assert [sent for sent, _ in counts(done)] == [STEPS, STEPS]
    assert [answered for _, answered in counts(done)] == [STEPS, STEPS]
    longest_s = max(
        each["monitors"]["out"]["latency"]["max"]
        for each in done.result()["metrics"]["rates"][0]["iterations"]
    )
    assert longest_s > 2.5, "the late answers keep their latency"


def test_what_comes_after_the_drain_timeout_is_lost(bench: Bench) -> None:
    done = run(bench, "PausesOnce", "500 ms", pause_s=4.0)
    (_, first), (_, second) = counts(done)
    assert first < STEPS
    assert second <= STEPS


def test_messages_that_were_dropped_before_an_answer_are_not_waited_for(bench: Bench) -> None:
    done = run_until(
        lambda each: counts(each) == [(STEPS, STEPS - 1)] * 2, bench, "DropsOne", "60 s"
    )
    segments = [each for each in done.run().record.segments if each.kind == "iteration"]
    assert all(answered < sent for sent, answered in counts(done))
    between_s = (segments[1].began_ns - segments[0].ended_ns) / 1e9
    # Not a rate: had the gap been waited for, it would have taken the whole minute.
    assert between_s < 50
