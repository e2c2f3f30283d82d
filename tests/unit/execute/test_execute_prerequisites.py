"""What a run needs of this machine: programs, shared memory, and a ROS domain of its own."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

from ament_packages import install_package
from plans import process_plan
from r2bspec.execute.errors import CertainRunError, NotInstalledError, RunError
from r2bspec.execute.processes import prerequisites
from r2bspec.execute.processes.environment import RunEnvironment
from r2bspec.execute.processes.prerequisites import (
    require_free_shared_memory,
    require_loopback,
    reserved_domain,
    resolve_argv,
)
from r2bspec.middleware.fast_dds import default_segment_bytes
from r2bspec.middleware.middleware import middleware_of
from r2bspec.plan.plan import Plan
from run_simulation import Simulation


def resolved(*argv: str) -> list[str]:
    return resolve_argv(process_plan("talker", argv=argv))


@pytest.fixture
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    programs = ["talker", "listener"]
    found = install_package(tmp_path / "install", "demo_nodes_cpp", programs=programs)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(found))
    return found


def test_an_executable_of_a_package_is_found(prefix: Path) -> None:
    argv = resolved("$(executable demo_nodes_cpp talker)", "--ros-args", "-r", "a:=b")
    assert argv == [str(prefix / "lib/demo_nodes_cpp/talker"), "--ros-args", "-r", "a:=b"]


@pytest.mark.parametrize(
    ("command", "message", "code"),
    [
        ("$(executable apriltag_ros node)", "'apriltag_ros' is not installed in 1", "R2B622"),
        ("$(executable demo_nodes_cpp speaker)", "no executable 'speaker'", "R2B623"),
        # A file that may not be executed, and a folder.
        ("$(executable demo_nodes_cpp readme)", "no executable 'readme'", "R2B623"),
        ("$(executable demo_nodes_cpp plugins)", "no executable 'plugins'", "R2B623"),
        ("no-such-program", "program 'no-such-program' is not on PATH", "R2B621"),
    ],
)
def test_what_is_not_installed_is_named(
    prefix: Path, command: str, message: str, code: str
) -> None:
    (prefix / "lib/demo_nodes_cpp/readme").write_text("text")
    (prefix / "lib/demo_nodes_cpp/plugins").mkdir()
    with pytest.raises(NotInstalledError, match=message) as raised:
        resolved(command)
    assert (raised.value.code, raised.value.exit_code) == (code, 2)
    if code == "R2B623":
        assert raised.value.hint == "Its executables: listener, talker."


def test_a_program_is_looked_up_on_the_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "node"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert resolved("node", "$HOME", "*") == [str(program), "$HOME", "*"]
    assert resolved("./node", "a b") == ["./node", "a b"]
    assert resolved("$(python)", "-m", "x") == [sys.executable, "-m", "x"]


MIB = 1 << 20
IMAGE = 1280 * 720 * 3
PROCESSES = 4  # with the observer, which no plan lists
FAST_DDS = middleware_of({})


@pytest.fixture
def plan() -> Plan:
    processes = tuple(process_plan(role, role) for role in ("player", "host", "monitor"))
    return msgspec.structs.replace(Simulation().plan(), processes=processes)


@pytest.fixture
def free(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Says how much the file system of the shared memory has free."""

    def has(count: int) -> None:
        monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(0, 0, count))

    return has


@pytest.mark.parametrize(("spare", "refused"), [(-1, True), (0, False)])
def test_the_limit_is_what_all_processes_of_the_phase_take(
    plan: Plan, free: Any, spare: int, refused: bool
) -> None:
    free(FAST_DDS.required_shm_bytes(PROCESSES, 10 * MIB) + spare)
    if refused:
        with pytest.raises(CertainRunError):
            require_free_shared_memory(plan, "measure", FAST_DDS, 10 * MIB)
    else:
        require_free_shared_memory(plan, "measure", FAST_DDS, 10 * MIB)
    # Nobody runs in the other phase.
    require_free_shared_memory(plan, "preprocess", FAST_DDS, 10 * MIB)


@pytest.mark.parametrize(
    ("transport", "middleware", "asked", "expected"),
    [
        ("shared_memory", "", 0, default_segment_bytes(IMAGE)),
        ("shared_memory", "rmw_fastrtps_dynamic_cpp", 7 * MIB, 7 * MIB),
        ("shared_memory", "rmw_cyclonedds_cpp", 7 * MIB, 0),
        ("udp", "", 7 * MIB, 0),
        ("inherit", "", 7 * MIB, 0),
    ],
)
def test_segments_are_the_runs_only_with_this_transport_and_middleware(
    plan: Plan,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    transport: Any,
    middleware: str,
    asked: int,
    expected: int,
) -> None:
    monkeypatch.delenv("RMW_IMPLEMENTATION", raising=False)
    if middleware:
        monkeypatch.setitem(os.environ, "RMW_IMPLEMENTATION", middleware)
    changed = msgspec.structs.replace(plan, transport=transport, segment_bytes=asked)
    made = RunEnvironment(
        changed, run_id="r", domain=1, scratch=tmp_path, largest_message_bytes=IMAGE
    )
    assert made.segment_bytes == expected


@pytest.fixture
def few_domains(monkeypatch: pytest.MonkeyPatch) -> range:
    """Only a few domains, far from those that other programs use."""
    # Ports of their own, so that what else runs on this machine does not matter.
    monkeypatch.setattr(prerequisites, "_PORT_BASE", 21_000 + os.getpid() % 5_000)
    monkeypatch.setattr(prerequisites, "_MIN_DOMAIN", 1)
    monkeypatch.setattr(prerequisites, "_MAX_DOMAIN", 4)
    return range(1, 5)


def test_reservations_differ_and_are_free_afterwards(few_domains: range) -> None:
    for _ in range(3):
        with contextlib.ExitStack() as stack:
            taken = [stack.enter_context(reserved_domain()) for _ in few_domains]
            assert sorted(taken) == list(few_domains)
            with pytest.raises(RunError, match="all ROS domains from 1 to 4 are in use"):
                stack.enter_context(reserved_domain())


def test_the_ports_of_every_domain_stay_clear_of_the_ephemeral_range() -> None:
    # OMG DDSI-RTPS 2.5, section 9.6.2.3: PB + DG x domain, and at most 250 ports from there.
    assert 7400 + 250 * (prerequisites._MAX_DOMAIN + 1) <= 32768
    assert prerequisites._MIN_DOMAIN >= 1


@pytest.mark.parametrize(("text", "domain"), [("", 0), ("7", 7), ("232", 232)])
def test_the_domain_of_external_nodes(
    text: str, domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    assert prerequisites.domain_of_user() == domain


@pytest.mark.parametrize("text", ["abc", "-1", "233", "1.5"])
def test_what_is_no_domain_is_said(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    with pytest.raises(CertainRunError, match="no number from 0 to"):
        prerequisites.domain_of_user()


def test_a_machine_without_loopback_is_named_before_anything_starts() -> None:
    require_loopback()
    program = (
        "from r2bspec.execute.processes.prerequisites import *\n"
        "try:\n    require_loopback()\nexcept errors.CertainRunError as error: print(error.code)"
    )
    isolated = ["unshare", "--user", "--map-root-user", "--net"]
    done = subprocess.run(
        [*isolated, sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    if "unshare" in done.stderr:
        pytest.skip(f"no network namespace can be made here: {done.stderr.strip()}")
    assert done.stdout.split() == ["R2B699"]
