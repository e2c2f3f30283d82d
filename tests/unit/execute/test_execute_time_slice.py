"""The time slice of player and monitor."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator

import pytest

from r2bspec.execute.processes.process import SLICE_NS, shorten_slice, slice_of


@pytest.fixture
def sleeper() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(["sleep", "60"]) as process:  # noqa: S607
        yield process
        process.kill()


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
