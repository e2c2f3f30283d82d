"""What processes use, orphans of a run among them, and what the kernel counts of the machine."""

from __future__ import annotations

import contextlib
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil
import pytest

from family_trees import Family, wait_for
from git_repositories import write_files
from r2bspec.execute.processes.resources import (
    InterferenceReader,
    Members,
    ResourceSampler,
    RunQueueWaits,
)
from r2bspec.ipc.protocol import RUN_ID_VARIABLE
from r2bspec.judge.measure.host_usage import CONTROLLER_INDEX, MACHINE_INDEX, ORPHANS_INDEX
from r2bspec.record.sample_arrays import INTERFERENCE_DTYPE, RESOURCE_DTYPE

HAS_A_BUSY_CHILD = (
    "import subprocess, sys; subprocess.Popen([sys.executable, '-c', 'while True: pass']).wait()"
)


def sampled(sampler: ResourceSampler, pid: int, enough: Callable[[], bool]) -> None:
    sampler.add(pid)
    sampler.start()
    wait_for(enough)


def used(sampler: ResourceSampler) -> np.ndarray:
    """The processor time of the first process, in seconds, at each sample."""
    rows = sampler.rows()
    return np.asarray(rows[rows["process"] == 0]["cpu_s"])


def test_processes_are_numbered_in_the_order_in_which_they_were_added() -> None:
    sampler = ResourceSampler()
    with contextlib.ExitStack() as stack:
        for _ in range(2):
            child = stack.enter_context(subprocess.Popen(["/bin/sleep", "60"]))
            stack.callback(child.kill)
            sampler.add(child.pid)
        rows, _ = sampler.stop()
    assert rows.dtype == RESOURCE_DTYPE
    assert rows["process"].tolist() == [MACHINE_INDEX, CONTROLLER_INDEX, 0, 1]
    assert np.all(rows["memory_bytes"] > 0)


def test_time_and_memory_of_descendants_count() -> None:
    sampler = ResourceSampler()
    with subprocess.Popen([sys.executable, "-c", HAS_A_BUSY_CHILD], start_new_session=True) as one:
        sampled(sampler, one.pid, lambda: bool(np.any(used(sampler) > 0.3)))
        # The child did the work; its parent only waits.
        own, resident = psutil.Process(one.pid).cpu_times().user, sampler.resident(one.pid)
        rows, _ = sampler.stop()
        os.killpg(one.pid, 9)
    assert rows[rows["process"] == 0]["cpu_s"][-1] > own
    assert resident > 0


def test_a_process_that_ends_is_sampled_no_more_and_disturbs_nobody() -> None:
    sampler = ResourceSampler()
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
        sampler.add(process.pid)
        rows, _ = sampler.stop()
    assert set(rows["process"]) == {MACHINE_INDEX, CONTROLLER_INDEX}
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


LEAVES_A_BUSY_CHILD = """
import subprocess, sys
child = subprocess.Popen([sys.executable, "-c", "while True: pass"], start_new_session=True)
print(child.pid, flush=True)
sys.stdin.read()
"""


def test_an_orphan_belongs_to_the_process_whose_session_it_is_in(people: Family) -> None:
    (orphan,) = people.start("gone-of-worker")
    (stranger,) = people.start("gone-of-stranger")
    people.collect()
    leaders = {session.pid: 3 for session in people.sessions}
    members = Members(people.run_id).find(leaders, ORPHANS_INDEX)
    # Of one with a session of its own, only the run is known.
    assert members == {3: [orphan], ORPHANS_INDEX: [stranger]}


def test_what_an_orphan_uses_stays_with_its_process(run_id: str) -> None:
    sampler = ResourceSampler(run_id)
    command = [sys.executable, "-c", LEAVES_A_BUSY_CHILD]
    with subprocess.Popen(
        command,
        env=os.environ | {RUN_ID_VARIABLE: run_id},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    ) as parent:
        assert parent.stdin is not None
        assert parent.stdout is not None
        child = psutil.Process(int(parent.stdout.readline()))
        try:
            sampler.add(parent.pid)
            sampler.start()
            wait_for(lambda: used(sampler).size >= 3 and np.ptp(used(sampler)) > 0.3)
            parent.stdin.close()
            parent.wait()
            before = used(sampler)
            wait_for(lambda: used(sampler).size >= before.size + 5)
        finally:
            child.kill()
        sampler.stop()
    found = used(sampler)
    assert found[-1] > before[-1]
    # Ticks are of 10 ms. It is counted all the time, and once: it has one thread.
    assert np.all(np.diff(found) >= -0.02)
    assert np.ptp(found) <= np.ptp(times_ns(sampler)) / 1e9 + 0.2


def times_ns(sampler: ResourceSampler) -> np.ndarray:
    rows = sampler.rows()
    return np.asarray(rows[rows["process"] == 0]["time_ns"])


def test_this_machine() -> None:
    reader = InterferenceReader()
    first = reader.read()
    end = time.process_time() + 0.1
    while time.process_time() < end:
        pass
    second = reader.read()
    assert second.busy_s > first.busy_s
    for before, after in zip(first, second, strict=True):
        assert math.isnan(before) == math.isnan(after)
        assert math.isnan(before) or after >= before


def test_cores_are_known_by_their_numbers_where_others_are_offline(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """psutil leaves out what is offline: of cores 0, 2 and 3, the second is core 2."""
    cores = {0: 1, 2: 20, 3: 300}
    lines = [f"cpu{number} {100 * busy} 0 0 0 0 0 0 0 0 0" for number, busy in cores.items()]
    write_files(tmp_path, {"stat": "\n".join(["cpu  0 0 0 0 0 0 0 0 0 0", *lines, "intr 5", ""])})
    monkeypatch.setattr(psutil, "PROCFS_PATH", str(tmp_path))
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {1, 2})
    ticks = os.sysconf("SC_CLK_TCK")
    assert InterferenceReader(tmp_path).read().busy_s == pytest.approx(2000 / ticks)


def frequency_file(core: int) -> str:
    return f"sys/devices/system/cpu/cpu{core}/cpufreq/scaling_cur_freq"


def cycles_of_work(root: Path, *khz: int) -> tuple[float, float]:
    """The CPU time and the cycles of all cores while this one works at each frequency in turn."""
    cores = os.sched_getaffinity(0)
    write_files(root, {frequency_file(core): f"{khz[0]}\n" for core in cores})
    reader = InterferenceReader(root)
    first = last = reader.read()
    for value in khz:
        write_files(root, {frequency_file(core): f"{value}\n" for core in cores})
        end = time.process_time() + 0.1
        while time.process_time() < end:
            pass
        last = reader.read()
    return last.busy_s - first.busy_s, last.cycles - first.cycles


def test_cycles_are_cpu_time_at_the_frequency_of_its_time(tmp_path: Path) -> None:
    used_s, cycles = cycles_of_work(tmp_path, 2_500_000)
    assert cycles == pytest.approx(used_s * 2.5e9, rel=1e-6)
    used_s, cycles = cycles_of_work(tmp_path, 1_000_000, 3_000_000)
    assert 1e9 * used_s < cycles < 3e9 * used_s
