"""Processes are bound to processors, and given a priority and a time slice, from outside."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from typing import Any

import pytest

from r2bspec.execute.errors import RunError
from r2bspec.execute.processes.process import SLICE_NS, apply_affinity, shorten_slice, slice_of
from r2bspec.plan.plan import ProcessPlan


@pytest.fixture
def sleeper() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(["/bin/sleep", "60"]) as process:
        yield process
        process.kill()


def plan(**changes: Any) -> ProcessPlan:
    return ProcessPlan(
        name="detector", role="command", phase="measure", argv=("sleep",), env={}, **changes
    )


def test_processors_and_priority(sleeper: subprocess.Popen[bytes]) -> None:
    first = min(os.sched_getaffinity(0))
    apply_affinity(plan(cpus=(first,), nice=5), sleeper.pid)
    assert os.sched_getaffinity(sleeper.pid) == {first}
    assert os.getpriority(os.PRIO_PROCESS, sleeper.pid) == os.getpriority(os.PRIO_PROCESS, 0) + 5


def test_a_processor_that_is_not_there_is_named(sleeper: subprocess.Popen[bytes]) -> None:
    with pytest.raises(RunError, match="detector cannot run on CPUs 4095") as caught:
        apply_affinity(plan(cpus=(4095,)), sleeper.pid)
    assert caught.value.code == "R2B636"


def test_a_process_that_has_ended_already_is_left_to_its_watcher() -> None:
    process = subprocess.Popen(["/bin/true"])
    process.wait()
    apply_affinity(plan(nice=1, cpus=(min(os.sched_getaffinity(0)),)), process.pid)


@pytest.mark.skipif(slice_of(0) == 0, reason="this kernel has no time slices for each process")
def test_a_process_gets_a_shorter_slice_and_keeps_the_rest(
    sleeper: subprocess.Popen[bytes],
) -> None:
    own = slice_of(0)
    os.setpriority(os.PRIO_PROCESS, sleeper.pid, 19)
    assert shorten_slice(sleeper.pid)
    assert slice_of(sleeper.pid) == SLICE_NS
    assert os.getpriority(os.PRIO_PROCESS, sleeper.pid) == 19
    assert slice_of(0) == own


def test_one_that_is_gone_is_left_alone(sleeper: subprocess.Popen[bytes]) -> None:
    sleeper.kill()
    sleeper.wait()
    assert not shorten_slice(sleeper.pid)
    assert slice_of(sleeper.pid) == 0


def test_an_unknown_machine_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platform.machine", lambda: "vax")
    assert not shorten_slice(0)


@pytest.mark.skipif(os.geteuid() != 0, reason="a real-time policy needs the rights of root")
def test_a_real_time_policy_stays(sleeper: subprocess.Popen[bytes]) -> None:
    try:
        os.sched_setscheduler(sleeper.pid, os.SCHED_FIFO, os.sched_param(1))
    except OSError:
        pytest.skip("this machine has no real-time policy")
    assert not shorten_slice(sleeper.pid)
    assert os.sched_getscheduler(sleeper.pid) == os.SCHED_FIFO
