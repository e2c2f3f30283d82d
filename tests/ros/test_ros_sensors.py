"""Promise: sensors that are not in step are played as they were recorded, and judged as such."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from ros_runs import IMAGE, Bench, Finished, quick_input, relay_spec
from ros_runs import bench as bench

NODES = """
def nanoseconds(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


class Fusion(Node):
    '''Pairs images by the nearest stamps; its output carries the stamp of `keeps`.'''

    def __init__(self, **kwargs):
        super().__init__("fusion", **kwargs)
        self.slop_ns = self.declare_parameter("slop_ms", 5.0).value * 1e6
        self.keeps = self.declare_parameter("keeps", "left").value
        self.kept = {"left": {}, "right": {}}
        self.out = self.create_publisher(Image, "output", 200)
        for side in self.kept:
            self.create_subscription(
                Image, side, lambda message, side=side: self.pair(side, message), 200
            )

    def pair(self, side, message):
        other = "right" if side == "left" else "left"
        stamp_ns = nanoseconds(message)
        near = [each for each in self.kept[other] if abs(each - stamp_ns) <= self.slop_ns]
        if not near:
            self.kept[side][stamp_ns] = message
            return
        partner = self.kept[other].pop(min(near, key=lambda each: abs(each - stamp_ns)))
        self.out.publish(message if side == self.keeps else partner)


class EveryThird(Node):
    '''Publishes every third message, as a node of a third of the rate does, with its stamp.'''

    def __init__(self, **kwargs):
        super().__init__("every_third", **kwargs)
        self.seen = 0
        self.out = self.create_publisher(Image, "output", 200)
        self.create_subscription(Image, "input", self.take, 200)

    def take(self, message):
        self.seen += 1
        if self.seen % 3 == 1:
            self.out.publish(message)


class Counts(Node):
    '''Answers every image; the height is the number of fast messages since the last image.'''

    def __init__(self, **kwargs):
        super().__init__("counts", **kwargs)
        self.fast, self.backwards, self.last_ns = 0, 0, 0
        self.out = self.create_publisher(Image, "output", 200)
        self.create_subscription(Image, "input", self.answer, 200)
        self.create_subscription(Image, "fast", self.count, 200)

    def count(self, message):
        self.fast += 1

    def answer(self, message):
        self.get_logger().info(f"{self.fast} fast messages")
        self.fast = 0
        self.out.publish(message)
"""

LEFT_MS = range(0, 330, 33)
RIGHT_MS = [each + 3 for each in LEFT_MS if each != 132]


TOPICS = {
    "/left": LEFT_MS,
    "/right": RIGHT_MS,
    "/fast": range(1, 330, 5),
    "/slow": LEFT_MS[::2],
}


def stereo_spec(pairing: Mapping[str, Any], keeps: str = "left", **playback: Any) -> dict[str, Any]:
    return relay_spec(
        data_loader={"bag": "./bag", "topics": {"/left": "loaded/left", "/right": "loaded/right"}},
        playback={
            "pairing": pairing,
            "inputs": {
                "left": quick_input("loaded/left"),
                "right": quick_input("loaded/right"),
            },
        }
        | playback,
        graph={
            "nodes": {"fusion": {"python": "./nodes.py:Fusion", "parameters": {"keeps": keeps}}}
        },
    )


@pytest.mark.parametrize("keeps", ["left", pytest.param("right", marks=only_nightly())])
def test_two_cameras_that_are_not_in_step_are_played_at_a_rate(bench: Bench, keeps: str) -> None:
    done = bench.run(stereo_spec({"slop": "10 ms"}, keeps))
    done.assert_complete()
    seen = done.monitor()
    assert (seen["sent"], seen["answered"]) == (20, 20)
    assert seen["unmatched"] == seen["overdue"]
    # The difference of the stamps is as recorded: the node, which allows 5 ms, has paired them.
    assert any("1 of 10 messages of /r2b/left have no partner" in event for event in done.events())


def equal_stamps(steps: str) -> dict[str, Any]:
    """A node that combines messages of equal stamps only; the left ones are played between."""
    wanted = stereo_spec({"slop": "0 ms"}, keeps="right")
    wanted["data_loader"]["topics"] = {"/left": "loaded/left", steps: "loaded/right"}
    wanted["playback"]["inputs"]["left"]["rate"] = "recorded"
    wanted["graph"]["nodes"]["fusion"]["parameters"]["slop_ms"] = 0.0
    return wanted


@only_nightly()
def test_an_input_with_its_own_rate_keeps_the_stamps_that_are_those_of_steps(bench: Bench) -> None:
    done = bench.run(equal_stamps("/slow"))
    done.assert_complete()
    seen = done.monitor()
    assert (seen["sent"], seen["answered"]) == (20, 20)
    assert any("/r2b/left: 10 messages between the 5 steps" in event for event in done.events())


@only_nightly()
def test_a_node_that_gets_no_equal_stamps_is_told_so_before_patience_ends(bench: Bench) -> None:
    wanted = equal_stamps("/right")
    wanted["benchmark"]["start_timeout"] = "100 s"
    done = bench.run(wanted)
    assert done.error.startswith("error[R2B641 no-output]: no messages on /r2b/output")
    lacks = "No messages of /r2b/left and /r2b/right have equal stamps. If /r2b/fusion combines"
    assert lacks in done.error
    assert lacks in done.stderr.split("error[", 1)[0]
    assert sum("warm-up" in event for event in done.events()) < 30


@only_nightly()
def test_in_a_timeline_a_frame_without_a_partner_is_no_drop(bench: Bench) -> None:
    spec = stereo_spec({"slop": "10 ms"}, mode="timeline")
    spec["monitors"]["out"]["answers"] = ["left", "right"]
    del spec["benchmark"]["rates"]
    done = bench.run(spec)
    done.assert_complete()
    seen = done.monitor()
    assert seen["sent"] == seen["answered"] > 0
    assert seen["unmatched"] == seen["overdue"]


@pytest.fixture(scope="module")
def done(bench: Bench) -> Finished:
    """An input at its own rate beside another, and a node of a third of its rate."""
    fast = quick_input("loaded/fast") | {"rate": "recorded"}
    third = {"python": "./nodes.py:EveryThird", "remappings": {"output": "third"}}
    spec = relay_spec(
        data_loader={"bag": "./bag", "topics": {"/left": "loaded", "/fast": "loaded/fast"}},
        graph={"nodes": {"counts": {"python": "./nodes.py:Counts"}, "third": third}},
        playback={"inputs": {"input": quick_input("loaded"), "fast": fast}},
        monitors={
            "out": {"topic": "output", "format": IMAGE},
            "third": {"topic": "third", "format": IMAGE, "ratio": {"inputs": 3}},
        },
    )
    spec["benchmark"]["duration"] = "1500 ms"
    finished = bench.run(spec)
    finished.assert_complete()
    return finished


def test_a_node_of_a_third_of_the_rate_keeps_stamps_and_misses_nothing(done: Finished) -> None:
    seen = done.monitor("third")
    assert seen["sent"] == 30
    assert seen["answered"] + seen["missed"] in {9, 10}
    assert seen["missed"] <= 1
    # An output of the warm-up may come late.
    assert seen["unmatched"] == seen["overdue"]
    # The latency is that of the input whose stamp the output has, not of the group's last one.
    assert seen["latency"]["p50"] > 0


def test_an_input_with_its_own_rate_keeps_its_messages_between_two_steps(done: Finished) -> None:
    assert done.monitor()["answered"] == done.monitor()["sent"] == 30
    assert any("/r2b/fast: 66 messages between the 10 steps" in event for event in done.events())
    log = done.log("counts")
    numbers = [int(line.split()[-3]) for line in log.splitlines() if "fast messages" in line]
    # 66 messages for 10 images: 6 or 7 between any two, whatever order they are taken in.
    steady = numbers[1:]
    assert abs(sum(steady) / len(steady) - 6.6) < 0.5
