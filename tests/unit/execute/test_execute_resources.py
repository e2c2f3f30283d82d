"""Processor time and memory of real processes."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

from family_trees import wait_for
from r2bspec.execute.processes.resources import ResourceSampler
from r2bspec.measure.host_usage import CONTROLLER_INDEX, MACHINE_INDEX
from r2bspec.record.sample_arrays import INTERFERENCE_DTYPE, RESOURCE_DTYPE

BUSY = "while True: pass"
HAS_A_BUSY_CHILD = (
    "import subprocess, sys; subprocess.Popen([sys.executable, '-c', 'while True: pass']).wait()"
)


def sampled(sampler: ResourceSampler, pid: int, enough: Callable[[], bool]) -> None:
    sampler.add(pid)
    sampler.start()
    wait_for(enough)


def test_processes_are_numbered_in_the_order_in_which_they_were_added() -> None:
    sampler = ResourceSampler()
    sampler.add(os.getpid())
    sampler.add(os.getppid())
    rows, _ = sampler.stop()
    assert rows.dtype == RESOURCE_DTYPE
    assert rows["process"].tolist() == [MACHINE_INDEX, CONTROLLER_INDEX, 0, 1]
    assert np.all(rows["memory_bytes"] > 0)


def test_time_and_memory_of_descendants_count() -> None:
    sampler = ResourceSampler()
    with subprocess.Popen([sys.executable, "-c", HAS_A_BUSY_CHILD], start_new_session=True) as one:
        began = time.process_time()
        sampled(sampler, one.pid, lambda: sampler.resident(one.pid) > 0)
        time.sleep(1.0)
        rows, _ = sampler.stop()
        os.killpg(one.pid, 9)
    used = rows[rows["process"] == 0]["cpu_s"]
    # The child did the work; its parent and this process only wait.
    assert used[-1] > used[0]
    assert time.process_time() - began < 1.0


def test_samples_are_cumulative_and_in_order() -> None:
    sampler = ResourceSampler()
    with subprocess.Popen([sys.executable, "-c", BUSY]) as process:
        sampled(sampler, process.pid, lambda: sampler.rows().size >= 8)
        rows, _ = sampler.stop()
        process.kill()
    for number in (MACHINE_INDEX, CONTROLLER_INDEX, 0):
        one = rows[rows["process"] == number]
        assert one.size >= 3
        assert np.all(np.diff(one["time_ns"]) > 0)
        assert np.all(np.diff(one["cpu_s"]) >= 0)


def test_a_process_that_ends_is_sampled_no_more_and_disturbs_nobody() -> None:
    sampler = ResourceSampler()
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
        sampler.add(process.pid)
        sampler.add(os.getpid())
        rows, _ = sampler.stop()
    assert set(rows["process"]) == {MACHINE_INDEX, CONTROLLER_INDEX, 1}
    assert sampler.resident(process.pid) == 0


def test_a_sample_is_taken_when_it_is_asked_for() -> None:
    sampler = ResourceSampler()
    sampler.start()
    try:
        soon_ns = time.monotonic_ns() + 30_000_000
        wait_for(lambda: sampler.interference().size >= 1)
        sampler.sample_at(soon_ns)
        wait_for(lambda: bool(sampler.interference()["time_ns"][-1] >= soon_ns))
    finally:
        _, around = sampler.stop()
    assert around.dtype == INTERFERENCE_DTYPE
    after = around["time_ns"][around["time_ns"] >= soon_ns]
    # Not the one of the period, which was due when the last one was 200 ms old.
    previous = around["time_ns"][around["time_ns"] < soon_ns][-1]
    assert after[0] >= soon_ns > previous


def test_times_that_were_asked_for_and_are_past_are_one_sample() -> None:
    sampler = ResourceSampler()
    for _ in range(50):
        sampler.sample_at(0)
    sampler.start()
    wait_for(lambda: sampler.interference().size >= 3)
    sampler.stop()
    assert not sampler._requested_ns


def test_what_a_process_uses_lately() -> None:
    sampler = ResourceSampler()
    with subprocess.Popen([sys.executable, "-c", BUSY]) as process:
        assert sampler.cores(process.pid) is None
        sampled(sampler, process.pid, lambda: bool(sampler.cores(process.pid)))
        process.kill()
        process.wait()
        wait_for(lambda: sampler.cores(process.pid) is None)
        sampler.stop()
