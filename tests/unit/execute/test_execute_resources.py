"""Processor time, memory, page faults and run-queue waits of real processes."""

from __future__ import annotations

import math
import mmap
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from family_trees import wait_for
from r2bspec.execute.processes import resources
from r2bspec.execute.processes.resources import ResourceSampler, RunQueueWaits
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


def test_touching_fresh_memory_is_counted() -> None:
    before = resources.minor_faults(os.getpid())
    with mmap.mmap(-1, 64 * mmap.PAGESIZE) as fresh:
        for at in range(0, len(fresh), mmap.PAGESIZE):
            fresh[at] = 1
    assert resources.minor_faults(os.getpid()) > before > 0


def test_those_of_children_that_have_ended_belong_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    stat = b"7 (a (strange) name) S 1 7 7 0 -1 4194560 120 30 2 1 5 6 0 0\n"
    monkeypatch.setattr(Path, "read_bytes", lambda _: stat)
    assert resources.minor_faults(7) == 150


def test_a_process_that_is_gone_has_none() -> None:
    assert resources.minor_faults(2**22 + 1) == 0


SCHEDSTAT = Path("/proc/self/schedstat")


def wait_files(proc: Path, pid: int, *waits_ns: int) -> None:
    for thread, wait_ns in enumerate(waits_ns):
        folder = proc / str(pid) / "task" / str(pid + thread)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "schedstat").write_text(f"1 {wait_ns} 1\n")


def test_waits_of_all_threads_add_up_and_stay_counted(tmp_path: Path) -> None:
    (tmp_path / "self").mkdir()
    (tmp_path / "self" / "schedstat").write_text("0 0 0\n")
    waits = RunQueueWaits(tmp_path)
    wait_files(tmp_path, 10, 10**9, 2 * 10**9)
    wait_files(tmp_path, 20, 4 * 10**9)
    assert waits.update(0, [10, 20]) == 7.0
    assert waits.update(1, []) == 0.0
    # A process that has ended, and one whose number is used again.
    wait_files(tmp_path, 10, 10**9, 5 * 10**8)
    assert waits.update(0, [10, 99]) == 7.5


def test_without_the_counters_of_the_kernel_nothing_is_known(tmp_path: Path) -> None:
    assert math.isnan(RunQueueWaits(tmp_path).update(0, [os.getpid()]))


@pytest.mark.skipif(not SCHEDSTAT.exists(), reason="this kernel does not count run-queue waits")
def test_two_busy_programs_on_one_processor_wait_for_each_other() -> None:
    core = min(os.sched_getaffinity(0))
    code = f"import os; os.sched_setaffinity(0, [{core}])\nwhile True: pass"
    waits = RunQueueWaits()
    with (
        subprocess.Popen([sys.executable, "-c", code]) as one,
        subprocess.Popen([sys.executable, "-c", code]) as two,
    ):
        try:
            wait_for(lambda: min(waits.update(0, [one.pid]), waits.update(1, [two.pid])) > 0.05)
        finally:
            one.kill()
            two.kill()
