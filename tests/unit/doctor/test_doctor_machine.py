"""What the doctor says of machines: each is a tree of files like those of /proc and /sys."""

from __future__ import annotations

import dataclasses
import os
import shutil
from collections import namedtuple
from pathlib import Path

import pytest

from r2bspec.doctor.checks import check_processor, check_shared_memory, check_sockets
from r2bspec.doctor.checkup import CheckResult, System
from r2bspec.middleware.fast_dds import SOCKET_BUFFER_BYTES

Usage = namedtuple("Usage", "total used free")


@pytest.fixture
def system(tmp_path: Path) -> System:
    return System(proc=tmp_path / "proc", sys=tmp_path / "sys", environ={})


def tell(path: Path, text: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"{text}\n")


def only(checks: list[CheckResult], name: str) -> CheckResult:
    return next(check for check in checks if check.name == name)


@pytest.mark.parametrize(
    ("rmw", "limit", "receive", "send"),
    [
        ("", 212_992, "warn", "warn"),
        ("", SOCKET_BUFFER_BYTES, "ok", "ok"),
        ("rmw_cyclonedds_cpp", 212_992, "warn", "ok"),
        ("rmw_cyclonedds_cpp", 1 << 20, "ok", "ok"),
        ("rmw_zenoh_cpp", 212_992, "ok", "ok"),
        ("rmw_fastrtps_dynamic_cpp", 1 << 20, "warn", "warn"),
    ],
)
def test_socket_buffers_are_those_of_the_selected_middleware(
    system: System, rmw: str, limit: int, receive: str, send: str
) -> None:
    system = dataclasses.replace(system, environ={"RMW_IMPLEMENTATION": rmw})
    for name in ("rmem_max", "wmem_max"):
        tell(system.proc / "sys/net/core" / name, limit)
    checks = check_sockets(system)
    found = [only(checks, f"{direction} buffers") for direction in ("receive", "send")]
    assert [check.status for check in found] == [receive, send]
    assert found[0].data["net.core.rmem_max"] == limit
    assert ("net.core.rmem_max=" in found[0].advice) == (receive == "warn")


@pytest.mark.parametrize(
    ("free", "status"), [(16 << 20, "problem"), (64 << 20, "warn"), (8 << 30, "ok")]
)
def test_shared_memory_must_hold_the_segments_of_a_run(
    system: System, monkeypatch: pytest.MonkeyPatch, free: int, status: str
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: Usage(2 * free, free, free))
    (check,) = check_shared_memory(system)
    assert check.status == status
    assert check.data["free_bytes"] == free
    assert bool(check.advice) == (status != "ok")


def cores(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: set(range(count)))


def examined(system: System) -> list[CheckResult]:
    return check_processor(system, sleep=lambda _seconds: None)


V2 = {"proc/self/cgroup": "0::/"}
NESTED = {"proc/self/cgroup": "0::/pod/box", "sys/fs/cgroup/pod/box/cpu.max": "max 100000"}
V1 = {"proc/self/cgroup": "5:cpu,cpuacct:/docker/1a\n0::/docker/1a"}
V1_GROUP = "sys/fs/cgroup/cpu,cpuacct"


@pytest.mark.parametrize(
    ("count", "files", "status", "quota"),
    [
        (2, {}, "warn", None),
        (8, {}, "ok", None),
        (8, V2 | {"sys/fs/cgroup/cpu.max": "max 100000"}, "ok", None),
        (8, V2 | {"sys/fs/cgroup/cpu.max": "800000 100000"}, "ok", 8.0),
        (8, V2 | {"sys/fs/cgroup/cpu.max": "250000 100000"}, "warn", 2.5),
        (8, NESTED | {"sys/fs/cgroup/pod/cpu.max": "150000 100000"}, "warn", 1.5),
        (
            8,
            V1
            | {f"{V1_GROUP}/cpu.cfs_quota_us": "50000", f"{V1_GROUP}/cpu.cfs_period_us": "100000"},
            "warn",
            0.5,
        ),
        (
            8,
            V1 | {f"{V1_GROUP}/cpu.cfs_quota_us": "-1", f"{V1_GROUP}/cpu.cfs_period_us": "100000"},
            "ok",
            None,
        ),
    ],
    ids=["few", "no group", "no limit", "as many", "v2", "nested", "v1", "v1 without limit"],
)
def test_cores_and_the_quota_on_them(
    system: System,
    monkeypatch: pytest.MonkeyPatch,
    count: int,
    files: dict[str, str],
    status: str,
    quota: float | None,
) -> None:
    cores(monkeypatch, count)
    for name, text in files.items():
        tell(system.proc.parent / name, text)
    found = only(examined(system), "cores")
    assert (found.status, found.data["quota"]) == (status, quota)


@pytest.mark.parametrize(
    ("spent", "status", "busy", "stolen"),
    [
        # user nice system idle iowait irq softirq steal
        ((1, 0, 1, 97, 1, 0, 0, 0), "ok", 0.02, 0.0),
        ((40, 0, 10, 50, 0, 0, 0, 0), "warn", 0.5, 0.0),
        ((1, 0, 0, 95, 0, 0, 0, 4), "warn", 0.05, 0.04),
    ],
)
def test_load_is_what_was_spent_while_the_doctor_slept(
    system: System, spent: tuple[int, ...], status: str, busy: float, stolen: float
) -> None:
    before = [1000, 5, 200, 9000, 7, 0, 3, 11]

    def sleep(_seconds: float) -> None:
        after = [early + more for early, more in zip(before, spent, strict=True)]
        tell(system.proc / "stat", f"cpu  {' '.join(map(str, after))} 0 0")

    tell(system.proc / "stat", f"cpu  {' '.join(map(str, before))} 0 0\ncpu0 1 1 1 1 1 1 1 1 0 0")
    check = only(check_processor(system, sleep=sleep), "idle load")
    assert check.status == status
    assert check.data == {"busy": pytest.approx(busy), "stolen": pytest.approx(stolen)}
