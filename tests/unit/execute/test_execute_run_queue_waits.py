"""The run-queue wait of processes: real ones that compete, and simulated files of the kernel."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

from family_trees import wait_for
from r2bspec.execute.processes.resources import RunQueueWaits

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
