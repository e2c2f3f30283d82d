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
    return Bench(tmp_path_factory.mktemp("harness_overhead")).run(relay_spec(playback=plain))


def test_each_run_has_the_floor_of_its_input(done: Finished) -> None:
    assert done.status == 0, done.stderr
    (overhead,) = done.run().record.harness_overhead
    assert overhead.topic.endswith("/input")
    assert overhead.rate_hz == 20.0
    assert overhead.sent == overhead.received == 20
    assert overhead.bytes > 64 * 48 * 3
    assert overhead.latency_p50_ns is not None
    assert overhead.latency_p99_ns is not None
    assert 0 < overhead.latency_p50_ns <= overhead.latency_p99_ns


def test_the_floor_is_below_every_latency_of_the_run(done: Finished) -> None:
    (overhead,) = done.run().record.harness_overhead
    latency = done.result()["metrics"]["rates"][0]["pooled"]["monitors"]["out"]["latency"]
    assert overhead.latency_p50_ns is not None
    # The relay alone works longer than a message is under way.
    assert overhead.latency_p50_ns / 1e9 < latency["p50"]


def test_what_was_played_for_the_floor_is_in_no_segment(done: Finished) -> None:
    run = done.run()
    for segment in run.record.segments:
        playback, out = run.playback(segment), run.monitor(segment, "out")
        assert playback.size == segment.steps
        assert set(out["stamp_ns"]) <= set(playback["stamp_ns"])
