"""Promise: what the machine did is not reported as what the graph did."""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from ros_runs import Bench, Finished, relay_spec

HELD_S = 0.7


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("player", r"began over 25 ms after they were due \(p99 {time}\)"),
        pytest.param("monitor", r"The monitor had no processor for {time}", marks=only_nightly()),
    ],
)
def test_a_run_whose_harness_had_no_time_is_invalid_and_says_by_how_much(
    tmp_path: Path, name: str, words: str
) -> None:
    """A part of the harness is stopped for a while, as a machine does that has no time for it."""
    spec = relay_spec(slos={"answers": {"at": "20 Hz", "require": ["latency.p50 < 1 h"]}})
    spec["benchmark"] |= {"iterations": 1, "duration": "2 s"}
    with Bench(tmp_path).start(spec) as running:
        running.wait_for("iteration 1 of 1")
        process = running.child(name)
        # What is late is late in the middle of the iteration.
        running.wait_for_messages("out", 10)
        process.suspend()
        time.sleep(HELD_S)
        process.resume()
        done = running.finish()
    assert done.status == 4
    assert done.outcome == "invalid"
    assert done.run().record.status == "complete"
    (segment,) = done.segments()
    # A busy machine may add to that, and the last of what was late was not late by all of it.
    if name == "monitor":
        assert segment.monitor_held_ns > HELD_S / 2 * 1e9
    # Should the player have been late of itself, that is what is said.
    if name == "player" or "began over" not in done.stdout:
        assert measured_s(done, words) > HELD_S / 2
    # Nothing was lost by it, and nothing is said about how fast the graph was.
    assert done.monitor()["answered"] == 40
    assert "PASS" not in done.stdout


def measured_s(done: Finished, words: str) -> float:
    """The time in a sentence of the report."""
    pattern = words.format(time=r"(?P<value>[0-9.]+) (?P<unit>m?s)")
    said = re.search(pattern, done.words)
    assert said, done.stdout
    return float(said["value"]) * (1e-3 if said["unit"] == "ms" else 1.0)
