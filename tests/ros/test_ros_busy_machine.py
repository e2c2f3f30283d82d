"""Real runs while programs of others use every processor: what fails, what is said, what is not."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from busy_programs import BUSY, busy_programs
from ros_runs import Bench, relay_node, relay_spec
from ros_runs import bench as bench

# Its strangers would disturb what is tested beside it.
pytestmark = only_nightly()

SAID = "other processes used"


@pytest.fixture(scope="module", autouse=True)
def strangers() -> Iterator[None]:
    """A program of somebody else on each processor that the run may use."""
    with busy_programs(len(os.sched_getaffinity(0))):
        yield


def sleeper(milliseconds: float) -> dict[str, Any]:
    """A node that needs no processor for most of the time that it takes."""
    node = relay_node(milliseconds)
    return node | {"parameters": node["parameters"] | {"spin": False, "queue_depth": 5}}


def spec(node: dict[str, Any], interference: str, *require: str) -> dict[str, Any]:
    return relay_spec(
        graph={"nodes": {"relay": node}},
        benchmark={
            "duration": "10 s",
            "iterations": 2,
            # Half a period is late: busy programs delay no publication by a quarter of a second.
            "rates": ["2 Hz"],
            "warm_up": "100 ms",
            "start_timeout": "120 s",
            "gate": {"confirm": False, "interference": interference},
        },
        slos={"slo": {"at": "2 Hz", "require": list(require)}},
    )


@pytest.mark.skipif(
    not Path("/proc/self/schedstat").exists(), reason="this kernel does not count run-queue waits"
)
def test_a_node_that_sleeps_too_long_fails_on_a_busy_machine(bench: Bench) -> None:
    asked = "throughput.mean >= 95 % of offered"
    done = bench.run(spec(sleeper(1500.0), "note", asked))
    # A second and a half for each of 2 messages a second: a third of them at best.
    assert done.status == 1
    (one,) = done.result()["verdict"]["requirements"]
    assert one["outcome"] == "fail"
    assert SAID in done.words
    assert "The faster half of the messages" in done.words or "unaffected part fails" in done.words


def test_a_tolerant_gate_judges_as_measured_and_says_what_was_there(bench: Bench) -> None:
    done = bench.run(spec(sleeper(1.0), "tolerate", "latency.p50 < 60 s"))
    assert (done.status, done.outcome) == (0, "pass")
    assert SAID in done.words
    assert not [segment for segment in done.run().record.segments if segment.rerun_of]


def test_a_peak_among_strangers_is_at_best_a_lower_bound(bench: Bench) -> None:
    done = bench.run(
        relay_spec(
            graph={"nodes": {"relay": relay_node(10.0)}},
            benchmark={
                "duration": "500 ms",
                "iterations": 1,
                "warm_up": "100 ms",
                "start_timeout": "120 s",
                "search": {
                    "min": "10 Hz",
                    "max": "150 Hz",
                    "precision": "10 %",
                    "probe": "3 s",
                    "confirm": "3 s",
                },
                "gate": {"confirm": False},
            },
            slos={"peak": {"level": "info", "require": ["peak.rate >= 20 Hz"]}},
        )
    )
    search = done.run().record.search
    assert search is not None
    assert all(SAID in " ".join(probe.disturbed) for probe in search.probes)
    failed = {probe.rate_hz: probe for probe in search.probes if probe.holds is False}
    if search.limited_by == "graph":
        # Only a failure that the strangers cannot explain bounds it from above.
        assert search.fails_hz is not None
        assert not failed[search.fails_hz].explained
    elif search.limited_by == "interference":
        assert "during the probes above, other processes used" in done.words
    assert re.search(r"\d probes: .*other processes used", done.words)


def test_nothing_of_the_strangers_is_left_out() -> None:
    """The fixture's programs do run: otherwise the other tests show nothing."""
    me = psutil.Process()
    busy = [child for child in me.children() if BUSY in child.cmdline()]
    assert len(busy) == len(os.sched_getaffinity(0))
