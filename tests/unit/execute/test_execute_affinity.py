"""Processes are bound to processors and given a priority from outside."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from typing import Any

import pytest

from r2bspec.execute.errors import RunError
from r2bspec.execute.processes.process import apply_affinity
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
