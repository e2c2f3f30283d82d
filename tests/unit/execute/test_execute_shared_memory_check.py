"""Whether a phase finds the shared memory that its processes are told to use."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

import msgspec
import pytest

from r2bspec.execute.errors import SharedMemoryError
from r2bspec.execute.processes.environment import RunEnvironment
from r2bspec.execute.processes.prerequisites import require_free_shared_memory
from r2bspec.middleware.fast_dds import default_segment_bytes
from r2bspec.middleware.middleware import middleware_of
from r2bspec.plan.plan import Plan, ProcessPlan
from run_simulation import Simulation

MIB = 1 << 20
DOCKER = 64 * MIB
IMAGE = 1280 * 720 * 3
PROCESSES = 4  # with the observer, which no plan lists
FAST_DDS = middleware_of({})


@pytest.fixture
def plan() -> Plan:
    roles: tuple[Any, ...] = ("player", "host", "monitor")
    processes = tuple(
        ProcessPlan(name=role, role=role, phase="measure", argv=("x",), env={}) for role in roles
    )
    return msgspec.structs.replace(Simulation().plan(), processes=processes)


@pytest.fixture
def free(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Says how much the file system of the shared memory has free."""

    def has(count: int) -> None:
        monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(0, 0, count))

    return has


def test_a_small_message_fits_into_what_a_container_has(plan: Plan, free: Any) -> None:
    free(DOCKER)
    require_free_shared_memory(plan, "measure", FAST_DDS, default_segment_bytes(10_000))


def test_an_image_does_not_and_the_way_out_is_told(plan: Plan, free: Any) -> None:
    free(DOCKER)
    with pytest.raises(SharedMemoryError) as caught:
        require_free_shared_memory(plan, "measure", FAST_DDS, default_segment_bytes(IMAGE))
    error = caught.value
    assert (error.code, error.exit_code) == ("R2B664", 2)
    assert f"64 MiB free; the {PROCESSES} processes of the measure phase" in str(error)
    assert "a segment of 63.4 MiB each" in str(error)
    assert "transport: udp" in error.hint
    megabytes = int(error.hint.partition("--shm-size=")[2].partition("m")[0])
    assert megabytes * MIB >= FAST_DDS.required_shm_bytes(PROCESSES, default_segment_bytes(IMAGE))


@pytest.mark.parametrize(("spare", "refused"), [(-1, True), (0, False)])
def test_the_limit_is_what_all_processes_of_the_phase_take(
    plan: Plan, free: Any, spare: int, refused: bool
) -> None:
    free(FAST_DDS.required_shm_bytes(PROCESSES, 10 * MIB) + spare)
    if refused:
        with pytest.raises(SharedMemoryError):
            require_free_shared_memory(plan, "measure", FAST_DDS, 10 * MIB)
    else:
        require_free_shared_memory(plan, "measure", FAST_DDS, 10 * MIB)
    # Nobody runs in the other phase.
    require_free_shared_memory(plan, "preprocess", FAST_DDS, 10 * MIB)


def test_what_is_not_decided_here_is_not_refused(plan: Plan, free: Any) -> None:
    free(0)
    require_free_shared_memory(plan, "measure", FAST_DDS, 0)


def test_a_machine_without_shared_memory_is_told_so(plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(SharedMemoryError, match="there is no shared memory in .*/none"):
        require_free_shared_memory(plan, "measure", FAST_DDS, MIB, tmp_path / "none")


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
