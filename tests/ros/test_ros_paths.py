"""Ways through a graph: several messages to one and one to several, odd answers.

One run of nodes that each do their own thing to the messages, with a monitor for each.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

from ros_runs import IMAGE, Bench, Finished, quick_input, relay_node, relay_spec
from ros_runs import bench as bench

STRING = "std_msgs/msg/String"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"

WARM_UP, STEPS, ITERATIONS = 10, 20, 2
TOPICS = dict.fromkeys(("/camera", "/right"), range(0, 330, 33))

NODES = f"""
from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import String


class Odd(Node):
    # What it answers is up to its kind; the first {WARM_UP} messages warm it up.
    of = Image

    def __init__(self, **kwargs):
        super().__init__("odd", **kwargs)
        self.count = 0
        self.kept = None
        self.out = self.create_publisher(self.of, "output", 100)
        self.create_subscription(Image, "input", self.take, 100)

    def take(self, message):
        self.count += 1
        self.answer(message)


class TwoForThree(Odd):
    of = String

    def answer(self, message):
        if self.count % 3 == 0:
            self.out.publish(String(data="first"))
            self.out.publish(String(data="second"))


class Swaps(Odd):
    # The fourth answer of each twenty comes after the fifth.
    def answer(self, message):
        if (self.count - {WARM_UP}) % {STEPS} == 4:
            self.kept = message
            return
        self.out.publish(message)
        if self.kept is not None:
            self.out.publish(self.kept)
            self.kept = None


class Dawdles(Odd):
    # Every answer comes half a second later, so that the last ones come after the last input.
    def answer(self, message):
        timer = self.create_timer(0.5, lambda: (timer.cancel(), self.out.publish(message)))


class Procrastinates(Odd):
    # Answers the last message of the first iteration in the middle of the second.
    def answer(self, message):
        if self.count == {WARM_UP + STEPS}:
            self.kept = message
            return
        self.out.publish(message)
        if self.count == {WARM_UP + STEPS + 5}:
            self.out.publish(self.kept)


class Synchronises(Odd):
    of = DiagnosticArray

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.waiting = {{}}
        self.create_subscription(Image, "right", self.take, 100)

    def answer(self, message):
        stamp = (message.header.stamp.sec, message.header.stamp.nanosec)
        if stamp in self.waiting:
            self.out.publish(DiagnosticArray(header=self.waiting.pop(stamp).header))
        else:
            self.waiting[stamp] = message
"""


def spec() -> dict[str, Any]:
    """A chain, and five nodes beside it."""
    kinds = ("TwoForThree", "Swaps", "Dawdles", "Procrastinates", "Synchronises")
    odd = {
        kind.lower(): {"python": f"./nodes.py:{kind}", "remappings": {"output": kind.lower()}}
        for kind in kinds
    }
    types = {"twoforthree": STRING, "synchronises": DIAGNOSTICS}
    used = relay_spec(
        data_loader={"bag": "./bag", "topics": {"/camera": "loaded", "/right": "right/loaded"}},
        playback={
            "buffer": 5,
            "inputs": {"input": quick_input("loaded"), "right": quick_input("right/loaded")},
        },
        graph={
            "placement": "shared",
            "nodes": {
                "first": relay_node(remappings={"output": "between"}),
                "second": relay_node(remappings={"input": "between", "output": "more"}),
                "third": relay_node(remappings={"input": "more", "output": "last"}),
                **odd,
            },
        },
        monitors={
            "chain": {"topic": "last", "format": IMAGE},
            **{name: {"topic": name, "format": types.get(name, IMAGE)} for name in odd},
        },
    )
    used["monitors"]["twoforthree"] |= {"match": "order", "ratio": {"inputs": 3, "outputs": 2}}
    used["benchmark"] |= {
        "iterations": ITERATIONS,
        "rates": [f"{STEPS} Hz"],
        "drain_timeout": "2 s",
    }
    used["slos"] = {
        "ratio": {
            "at": f"{STEPS} Hz",
            "require": ["twoforthree.throughput.mean <= 200 % of offered"],
        }
    }
    return used


@pytest.fixture(scope="module")
def done(bench: Bench) -> Finished:
    finished = bench.run(spec())
    assert finished.status == 0 or finished.outcome in {"invalid", "inconclusive"}
    return finished


ALL = ITERATIONS * STEPS


def test_answers_that_are_fewer_or_more_than_inputs_are_counted_by_their_ratio(
    done: Finished,
) -> None:
    found = done.monitor("twoforthree")
    # The node counts on from one iteration to the next: of inputs 11 to 50, 13 complete a three.
    assert found["sent"] == ALL
    assert found["answered"] == 26
    assert (found["missed"], found["unmatched"], found["early"]) == (0, 0, 0)
    assert found["latency"]["min"] > 0
    assert f"{ALL} inputs, 26 outputs expected" in done.stdout


def test_of_offered_means_the_outputs_that_the_inputs_let_expect(done: Finished) -> None:
    (verdict,) = done.result()["verdict"]["requirements"]
    assert verdict["limit"] == pytest.approx(2 * STEPS * 2 / 3)


def test_answers_in_another_order_are_reordered(done: Finished) -> None:
    found = done.monitor("swaps")
    assert (found["answered"], found["reordered"], found["unmatched"]) == (ALL, ITERATIONS, 0)


def test_answers_after_the_end_of_playback_are_late_and_not_lost(done: Finished) -> None:
    found = done.monitor("dawdles")
    assert found["answered"] == ALL
    assert found["late"] >= ITERATIONS * STEPS // 4


def test_an_answer_that_was_given_up_is_overdue_and_no_strangers(done: Finished) -> None:
    found = done.monitor("procrastinates")
    assert (found["answered"], found["missed"]) == (ALL - 1, 1)
    assert (found["unmatched"], found["overdue"]) == (1, 1)
    assert "1 arrived in a later segment (counted as missed)" in done.words


def test_one_answer_to_two_inputs_has_their_stamp_whatever_its_type(done: Finished) -> None:
    found = done.monitor("synchronises")
    assert (found["answered"], found["missed"], found["unmatched"]) == (ALL, 0, 0)


def test_no_message_is_in_no_segment(done: Finished) -> None:
    run = done.run()
    stamps = np.concatenate([run.playback(segment)["stamp_ns"] for segment in run.record.segments])
    seen = np.concatenate(
        [run.monitor(segment, "procrastinates")["stamp_ns"] for segment in run.record.segments]
    )
    assert sorted(seen.tolist()) == sorted(stamps.tolist())
