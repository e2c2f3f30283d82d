"""Shared memory: whether there is room for the segments of a run."""

from __future__ import annotations

import shutil

from r2bspec.doctor.checkup import CheckResult, Status, System
from r2bspec.measure.units import show
from r2bspec.middleware.middleware import Middleware, Transport
from r2bspec.middleware.rmw_registry import middleware_of

TOPIC = "shared memory"

_PARTICIPANTS = 4
"""Player, monitor and two nodes: each has a segment of its own."""

_SIZES = (("1280x720 rgb8", 1280 * 720 * 3), ("1920x1200 rgb8", 1920 * 1200 * 3))


def check_shared_memory(system: System) -> list[CheckResult]:
    """How much is free, and how many processes that exchange images it holds."""
    middleware = middleware_of(system.environ)
    if not middleware.uses_shared_memory:
        found = f"not used by a run with {middleware.name}"
        return [CheckResult(topic=TOPIC, name="size", status="ok", found=found)]
    try:
        usage = shutil.disk_usage(system.shared_memory)
    except OSError as error:
        return [
            CheckResult(
                topic=TOPIC,
                name="size",
                status="problem",
                found=f"{system.shared_memory}: {error.strerror or error}",
                advice="mount a tmpfs there, or state transport: udp",
            )
        ]
    room = {name: usage.free // _segment_bytes(middleware, size) for name, size in _SIZES}
    status = _status(usage.free, _PARTICIPANTS * _segment_bytes(middleware, 0), room)
    return [
        CheckResult(
            topic=TOPIC,
            name="size",
            status=status,
            found=f"{show(usage.free, 'B')} free of {show(usage.total, 'B')}: room for "
            + ", ".join(f"{_processes(count)} at {name}" for name, count in room.items()),
            advice=""
            if status == "ok"
            else f"sudo mount -o remount,size=2G {system.shared_memory} (in a container: "
            "--shm-size=2g), or state transport: udp",
            data={"free_bytes": usage.free, "total_bytes": usage.total, "processes": room},
        )
    ]


def _segment_bytes(middleware: Middleware, message_bytes: int) -> int:
    return middleware.segment_bytes(Transport("shared_memory", message_bytes))


def _status(free: int, required: int, room: dict[str, int]) -> Status:
    if free < required:
        return "problem"
    return "ok" if min(room.values()) >= _PARTICIPANTS else "warn"


def _processes(count: int) -> str:
    return "1 process" if count == 1 else f"{count} processes"
