"""Promise: what the machine did is not reported as what the graph did."""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from ros_runs import Bench, relay_spec
from ros_runs import nothing_left as nothing_left


def test_a_run_whose_playback_missed_its_schedule_is_invalid_and_says_by_how_much(
    tmp_path: Path,
) -> None:
    """The player is held for longer than a period, as a machine without time for it does."""
    spec = relay_spec(slos={"answers": {"at": "20 Hz", "require": ["missed == 0"]}})
    spec["benchmark"] |= {"iterations": 1, "duration": "4 s"}
    with Bench(tmp_path).start(spec) as running:
        running.wait_for("iteration 1 of 1")
        player = running.child("player")
        # Some steps have been played: what is late is late in the middle of a segment.
        time.sleep(0.5)
        player.suspend()
        time.sleep(0.7)
        player.resume()
        done = running.finish()
    assert done.status == 4
    assert done.outcome == "invalid"
    assert done.run().record.status == "complete"
    said = re.search(
        r"began over 25 ms after they were due \(p99 (?P<late>[0-9.]+) (?P<unit>m?s)\)",
        " ".join(done.stdout.split()),
    )
    assert said, done.stdout
    late_s = float(said["late"]) * (1e-3 if said["unit"] == "ms" else 1.0)
    # It was held for 700 ms at least, a busy machine may add to that.
    assert late_s > 0.3
    # Nothing was lost by it, and nothing is said about how fast the graph was.
    (rate,) = done.result()["metrics"]["rates"]
    assert rate["pooled"]["monitors"]["out"]["answered"] == 80
    assert "PASS" not in done.stdout
