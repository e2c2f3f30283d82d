"""What a launcher leaves behind belongs to the run: an orphaned grandchild is no stranger."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("rclpy")

from r2bspec.execute.processes.resources import Members
from r2bspec.ipc.protocol import RUN_ID_VARIABLE
from ros_runs import IMAGE, Bench, relay_spec
from ros_runs import bench as bench

NODES = '''
import subprocess
import sys

WORKER = """
import time
until = time.monotonic() + 120
with open("worked", "a", buffering=1) as said:
    while time.monotonic() < until:
        pause = time.monotonic() + 0.05
        while time.monotonic() < pause:
            pass
        said.write(f"{time.monotonic_ns()} {time.process_time()}\\\\n")
"""
LAUNCHER = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {WORKER!r}])"


class Relay(Node):
    """Starts a launcher, which starts a worker and ends at once."""

    def __init__(self, **kwargs):
        super().__init__("relay", **kwargs)
        subprocess.run([sys.executable, "-c", LAUNCHER], check=True)
        self.out = self.create_publisher(Image, "output", 100)
        self.create_subscription(Image, "input", self.out.publish, 100)
'''


def test_the_processor_time_of_an_orphaned_grandchild_is_the_runs_own(
    bench: Bench,
) -> None:
    endpoints = {"publishes": {"output": IMAGE}, "subscribes": {"input": IMAGE}}
    spec = relay_spec(graph={"nodes": {"relay": {"python": "./nodes.py:Relay", **endpoints}}})
    spec["benchmark"] |= {"duration": "2 s", "iterations": 1}
    done = bench.run(spec)
    done.assert_complete()
    run = done.run()
    (segment,) = done.segments()
    index = [process.name for process in run.record.processes].index("relay")

    rows = run.resources()
    rows = rows[rows["process"] == index]
    worked = np.array([line.split() for line in (bench.folder / "worked").read_text().splitlines()])

    def used_s(times_ns: NDArray[np.float64], seconds: NDArray[np.float64]) -> float:
        ends = np.interp([segment.began_ns, segment.ended_ns], times_ns, seconds)
        return float(ends[1] - ends[0])

    by_worker = used_s(worked[:, 0].astype(np.float64), worked[:, 1].astype(np.float64))
    by_relay = used_s(rows["time_ns"].astype(np.float64), rows["cpu_s"])
    assert by_worker > 0
    # The node by itself relays twenty small images a second.
    assert by_relay >= 0.8 * by_worker
    (rate,) = done.result()["metrics"]["rates"]
    own_cores = rate["iterations"][0]["interference"]["own_cores"]
    seconds = (segment.ended_ns - segment.began_ns) / 1e9
    assert own_cores >= 0.8 * by_worker / seconds


def test_a_process_that_is_just_being_started_is_no_orphan() -> None:
    """It is a child of the controller, which has not added it yet."""
    command = [sys.executable, "-c", "input()"]
    environment = os.environ | {RUN_ID_VARIABLE: "a run"}
    with subprocess.Popen(
        command, env=environment, stdin=subprocess.PIPE, start_new_session=True
    ) as process:
        try:
            assert Members("a run").find({}, unknown=-1) == {}
        finally:
            process.kill()
