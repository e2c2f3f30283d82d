"""The floor of a run, and the calls of rcl that harness and floor rest on."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")

from r2bspec.harness import rcl_calls, rclpy_tools
from r2bspec.ipc.header_stamps import read_stamp, write_stamp
from r2bspec.language.spec import QoS
from ros_runs import Bench, Finished, relay_spec
from ros_runs import nothing_left as nothing_left

IMAGE = "sensor_msgs/msg/Image"
WAIT_S = 30.0


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    plain = {"buffer": 5, "inputs": {"input": {"from": "loaded", "format": IMAGE}}}
    return Bench(tmp_path_factory.mktemp("floor")).run(relay_spec(playback=plain))


def test_each_run_has_the_floor_of_its_input(done: Finished) -> None:
    assert done.status == 0, done.stderr
    (floor,) = done.run().record.floor
    assert floor.topic.endswith("/input")
    assert floor.rate_hz == 20.0
    assert floor.sent == floor.received == 20
    assert floor.bytes > 64 * 48 * 3
    assert floor.latency_p50_ns is not None
    assert floor.latency_p99_ns is not None
    assert 0 < floor.latency_p50_ns <= floor.latency_p99_ns


def test_the_floor_is_below_every_latency_of_the_run(done: Finished) -> None:
    (floor,) = done.run().record.floor
    latency = done.result()["metrics"]["rates"][0]["pooled"]["monitors"]["out"]["latency"]
    assert floor.latency_p50_ns is not None
    # The relay alone works longer than a message is under way.
    assert floor.latency_p50_ns / 1e9 < latency["p50"]


def test_what_was_played_for_the_floor_is_in_no_segment(done: Finished) -> None:
    run = done.run()
    for segment in run.record.segments:
        playback, out = run.playback(segment), run.monitor(segment, "out")
        assert playback.size == segment.steps
        assert set(out["stamp_ns"]) <= set(playback["stamp_ns"])


def messages(sizes: list[int]) -> list[bytearray]:
    from rclpy.serialization import serialize_message

    made = []
    for number, size in enumerate(sizes, 1):
        image = rclpy_tools.message_class(IMAGE)(data=bytes([number]) * size)
        message = bytearray(serialize_message(image))
        write_stamp(message, number * 10**9 + number)
        made.append(message)
    return made


class Pair:
    """A writer and a reader of one node, matched."""

    def __init__(self) -> None:
        self.node = rclpy_tools.start_node("pair")
        self.writer = rclpy_tools.RawPublisher(
            self.node, "/pair", IMAGE, rclpy_tools.profile(QoS())
        )
        self.reader = rclpy_tools.RawSubscription(
            self.node, "/pair", IMAGE, rclpy_tools.profile(QoS())
        )
        self.wait(lambda: self.writer.matches() > 0 and self.reader.matches() > 0)

    def wait(self, condition: Any) -> None:
        deadline = time.monotonic() + WAIT_S
        while not condition():
            assert time.monotonic() < deadline
            time.sleep(0.01)

    def take(self, how: Any) -> Any:
        deadline = time.monotonic() + WAIT_S
        while (found := how()) is None:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        return found


@pytest.fixture(params=["rcl", "rclpy"])
def pair(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Pair]:
    if request.param == "rclpy":
        monkeypatch.setattr(rcl_calls, "_library", lambda: None)
    else:
        assert rcl_calls._library() is not None
    yield Pair()
    rclpy_tools.finish()


def test_messages_arrive_as_they_were_at_the_time_of_publication(pair: Pair) -> None:
    sizes = [0, 7, 300_000, 1, 1_000]
    sent = messages(sizes)
    for message in sent:
        publish = pair.writer.publication(message)
        publish()
        data, received_ns = pair.take(pair.reader.take)
        assert data == bytes(message)
        assert received_ns <= time.time_ns()
        # The same memory again, patched in place.
        write_stamp(message, 77 * 10**9 + 5)
        publish()
        assert pair.take(pair.reader.take)[0] == bytes(message)


def test_a_publication_keeps_its_message(pair: Pair) -> None:
    made = messages([5_000])
    expected = bytes(made[0])
    publish = pair.writer.publication(made.pop())
    # Whatever would be put into memory that was given back.
    others = [bytearray(b"\xff") * len(expected) for _ in range(50)]
    publish()
    assert pair.take(pair.reader.take)[0] == expected
    assert others


def test_a_head_tells_stamp_and_size_of_small_and_large_messages_in_turn(pair: Pair) -> None:
    for number, message in enumerate(messages([1_000_000, 3, 40_000, 0, 2_000_000]), 1):
        pair.writer.publication(message)()
        head, size, _ = pair.take(pair.reader.take_head)
        assert read_stamp(head) == number * 10**9 + number
        assert size == len(message)
        assert len(head) == rcl_calls.HEAD_BYTES


def test_where_nothing_waits_nothing_is_taken(pair: Pair) -> None:
    assert pair.reader.take_head() is None
    assert pair.reader.take() is None


def test_a_reader_that_was_removed_is_waited_for_no_more(pair: Pair) -> None:
    loop = rclpy_tools.WaitLoop(pair.node)
    other = rclpy_tools.RawSubscription(pair.node, "/other", IMAGE, rclpy_tools.profile(QoS()))
    loop.add(other)
    loop.add(pair.reader)
    loop.remove(other)
    other.destroy()
    pair.writer.publication(messages([5])[0])()
    pair.wait(lambda: loop.wait(0.1) == [0])
    assert pair.reader.take_head() is not None
