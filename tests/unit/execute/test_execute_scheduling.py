"""Processes and threads on real CPUs with real priorities, and what the system forbids."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import textwrap
from collections.abc import Iterator

import pytest

from plans import process_plan
from r2bspec.execute.errors import RunError
from r2bspec.execute.processes.scheduling import (
    apply_to_process,
    on_core,
    read_scheduling,
    require_permitted,
)

FIRST = min(os.sched_getaffinity(0))

NAMED_THREADS = """
import ctypes, threading, time
def named(name):
    ctypes.CDLL(None).prctl(15, name.encode(), 0, 0, 0)
    ready.wait()
    time.sleep(60)
ready = threading.Barrier(4)
for name in ("dds.ev", "dds.shm", "executor"):
    threading.Thread(target=named, args=(name,), daemon=True).start()
ready.wait()
print(flush=True)
time.sleep(60)
"""


@pytest.fixture
def sleeper() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(["/bin/sleep", "60"]) as process:
        yield process
        process.kill()


@pytest.fixture
def threads() -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-c", NAMED_THREADS]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield process
        process.kill()


def test_processors_and_niceness(sleeper: subprocess.Popen[bytes]) -> None:
    nice = min(19, os.getpriority(os.PRIO_PROCESS, 0) + 5)
    apply_to_process(process_plan("detector", cpus=(FIRST,), nice=nice), sleeper.pid)
    (seen,) = read_scheduling(sleeper.pid)
    assert (seen.cpus, seen.nice, seen.policy, seen.count) == ((FIRST,), nice, "other", 1)


several_cpus = pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="needs two CPUs")


@several_cpus
def test_all_threads_run_on_one_core_for_a_time(threads: subprocess.Popen[bytes]) -> None:
    everywhere = tuple(sorted(os.sched_getaffinity(0)))

    def cpus() -> set[tuple[int, ...]]:
        return {record.cpus for record in read_scheduling(threads.pid)}

    with on_core(FIRST, [threads.pid]):
        assert cpus() == {(FIRST,)}
    assert cpus() == {everywhere}
    assert os.sched_getaffinity(0) == set(everywhere)


@several_cpus
@pytest.mark.parametrize("core", sorted(os.sched_getaffinity(0))[:2])
def test_a_process_with_cpus_of_its_own_keeps_them(
    sleeper: subprocess.Popen[bytes], core: int
) -> None:
    os.sched_setaffinity(sleeper.pid, {FIRST})
    with on_core(core, [sleeper.pid]):
        assert os.sched_getaffinity(sleeper.pid) == {FIRST}
    assert os.sched_getaffinity(sleeper.pid) == {FIRST}


@several_cpus
def test_a_process_with_a_policy_of_its_own_is_not_moved(
    sleeper: subprocess.Popen[bytes],
) -> None:
    os.sched_setscheduler(sleeper.pid, os.SCHED_BATCH, os.sched_param(0))
    with on_core(FIRST, [sleeper.pid]):
        assert os.sched_getaffinity(sleeper.pid) == os.sched_getaffinity(0)


def test_processes_that_have_ended_do_not_hinder(sleeper: subprocess.Popen[bytes]) -> None:
    with on_core(FIRST, [sleeper.pid]):
        sleeper.kill()
        sleeper.wait()
    with on_core(FIRST, [sleeper.pid]):
        assert sleeper.returncode is not None


def test_a_processor_that_is_not_there_is_named(sleeper: subprocess.Popen[bytes]) -> None:
    plan = process_plan("detector", cpus=(4095,))
    with pytest.raises(RunError, match="detector cannot run on CPUs 4095"):
        require_permitted([plan])
    with pytest.raises(RunError, match="detector cannot run on CPUs 4095") as caught:
        apply_to_process(plan, sleeper.pid)
    assert caught.value.code == "R2B636"


FORBIDDEN = {
    "scheduling=Scheduling(policy='fifo', priority=40)": "RLIMIT_RTPRIO is 0, and 40 is",
    "nice=-5": "RLIMIT_NICE is 0, and 25 is",
}


def test_what_a_limit_forbids_is_refused_with_the_limit() -> None:
    """In a process without the capability, whose limits are low; real, as root and as a user."""
    code = f"""
    import os, resource
    from plans import process_plan
    from r2bspec.execute.errors import RunError
    from r2bspec.execute.processes.scheduling import require_permitted
    from r2bspec.language.spec import Scheduling
    for which in (resource.RLIMIT_RTPRIO, resource.RLIMIT_NICE):
        resource.setrlimit(which, (0, 0))
    if os.getuid() == 0:
        os.setresuid(65534, 65534, 65534)
    for settings in {[*FORBIDDEN]}:
        try:
            require_permitted([eval(f'process_plan("detector", {{settings}})')])
        except RunError as error:
            print(repr(f"{{error.code}} {{error}} {{error.hint}}"))
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    for said, limit in zip(done.stdout.splitlines(), FORBIDDEN.values(), strict=True):
        said = str(ast.literal_eval(said))
        assert said.startswith("R2B637 process detector: ")
        assert limit in said
        assert "CAP_SYS_NICE" in said
        assert "--ulimit rtprio=99" in said
