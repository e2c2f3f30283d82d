"""Promise: what the machine did is not reported as what the graph did."""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from ros_runs import Bench, relay_spec

HELD_S = 0.7


@pytest.mark.parametrize("name", ["player", pytest.param("monitor", marks=only_nightly())])
def test_a_run_whose_harness_had_no_time_is_invalid_and_says_why(tmp_path: Path, name: str) -> None:
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
    assert (done.status, done.outcome) == (4, "invalid")
    assert done.run().record.status == "complete"
    (segment,) = done.segments()
    # A busy machine may add to that, and the last of what was late was not late by all of it.
    playback = done.run().playback(segment)
    late_ns = int((playback["published_ns"] - playback["due_ns"]).max())
    held_ns = late_ns if name == "player" else segment.monitor_held_ns
    assert held_ns > HELD_S / 2 * 1e9
    # On a busy machine the player may have been late of itself, too.
    assert re.search("began over|playback reached only|had no processor for", done.words)
    # Nothing was lost by it, and nothing is said about how fast the graph was.
    assert done.monitor()["answered"] == 40
    assert "PASS" not in done.stdout
