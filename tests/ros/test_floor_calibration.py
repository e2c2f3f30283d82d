"""The floor of a run."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")

from ros_runs import Bench, Finished, relay_spec
from ros_runs import nothing_left as nothing_left

IMAGE = "sensor_msgs/msg/Image"


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
