"""Processes of a run that lost their parent count as its own, not as other programs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest

from family_trees import wait_for
from r2bspec.execute.host.resource_sampler import ResourceSampler
from r2bspec.ipc.protocol import RUN_ID_VARIABLE
from r2bspec.measure.resource_usage import ORPHANS_INDEX, ResourceUse, resource_use

RUN_ID = f"orphans-{os.getpid()}"

LEAVES_A_BUSY_GRANDCHILD = """
import os, sys, time
if not os.fork():
    if sys.argv[2] == "daemon":
        os.setsid()
    if os.fork():
        os._exit(0)
    with open(sys.argv[1], "w") as file:
        file.write(f"{os.getpid()}\\n")
    while True:
        pass
os.wait()
while True:
    time.sleep(1)
"""


def use_of(sampler: ResourceSampler, number: int) -> ResourceUse | None:
    rows = sampler.rows()
    times = rows["time_ns"][rows["process"] == number]
    if times.size < 4:
        return None
    return resource_use(rows, frozenset({number}), int(times[1]), int(times[-1]))


@pytest.mark.parametrize(
    ("kind", "number"), [("child", 0), ("daemon", ORPHANS_INDEX)], ids=["its session", "a daemon"]
)
def test_an_orphaned_grandchild_is_of_the_run(tmp_path: Path, kind: str, number: int) -> None:
    pid_file = tmp_path / "pid"
    command = [sys.executable, "-c", LEAVES_A_BUSY_GRANDCHILD, str(pid_file), kind]
    environment = os.environ | {RUN_ID_VARIABLE: RUN_ID}
    with subprocess.Popen(command, start_new_session=True, env=environment) as parent:
        wait_for(lambda: pid_file.exists() and pid_file.read_text().endswith("\n"))
        orphan = psutil.Process(int(pid_file.read_text()))
        try:
            assert orphan.ppid() != parent.pid
            sampler = ResourceSampler(RUN_ID)
            sampler.add(parent.pid)
            sampler.start()
            wait_for(lambda: bool((use_of(sampler, number) or ResourceUse(0, 0, 0)).cpu_mean))
            orphan.kill()
            wait_for(lambda: not orphan.is_running() or orphan.status() == psutil.STATUS_ZOMBIE)
            rows, _ = sampler.stop()
        finally:
            for pid in (orphan.pid, parent.pid):
                if psutil.pid_exists(pid):
                    os.kill(pid, signal.SIGKILL)
    used = rows[rows["process"] == number]["cpu_s"]
    # What an orphan used is not forgotten when it ends.
    assert np.all(np.diff(used) >= 0)
    assert used[-1] > 0


def test_processes_of_others_do_not_count() -> None:
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as stranger:
        sampler = ResourceSampler(RUN_ID)
        sampler.start()
        wait_for(lambda: sampler.rows().size >= 8)
        rows, _ = sampler.stop()
        stranger.kill()
    assert ORPHANS_INDEX not in rows["process"]
