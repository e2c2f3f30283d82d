"""Ending what a run has started, and removing what dead processes leave in shared memory.

A process belongs to a run if it is in a session that the run opened, or carries the run's id in
its environment: the first finds every descendant that stayed, the second those that opened a
session of their own.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import time
from collections.abc import Iterable
from pathlib import Path

import psutil

from r2bspec.harness.protocol import RUN_ID_VARIABLE

SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - the place is fixed by POSIX shared memory
_LOCKS = ("_el", "_sl")
_SEGMENTS = ("fastrtps_*", "fastdds_*", "sem.fastrtps_*", "sem.fastdds_*")


def members(run_id: str, sessions: Iterable[int]) -> list[psutil.Process]:
    """Every living process of a run, the calling process excepted."""
    wanted = set(sessions)
    found = []
    for process in psutil.process_iter():
        if process.pid == os.getpid():
            continue
        with contextlib.suppress(psutil.Error, OSError):
            if not _runs(process):
                continue
            if os.getsid(process.pid) in wanted or _carries(process, run_id):
                found.append(process)
    return found


def _carries(process: psutil.Process, run_id: str) -> bool:
    try:
        return process.environ().get(RUN_ID_VARIABLE) == run_id
    except psutil.AccessDenied:
        return False


def end_all(run_id: str, sessions: Iterable[int], grace_s: float) -> list[str]:
    """End every process of a run: SIGTERM, `grace_s` seconds, then SIGKILL until none is left.

    Returns:
        The names of the processes that had to be killed.
    """
    wanted = set(sessions)
    remaining = members(run_id, wanted)
    for process in remaining:
        with contextlib.suppress(psutil.Error):
            process.terminate()
    _wait_for(remaining, grace_s)
    killed: list[str] = []
    # A process may fork while it is being killed, so look again until none is found.
    for _ in range(20):
        remaining = members(run_id, wanted)
        if not remaining:
            break
        for process in remaining:
            with contextlib.suppress(psutil.Error):
                killed.append(process.name())
                process.kill()
        _wait_for(remaining, 1.0)
    return killed


def _wait_for(processes: list[psutil.Process], patience_s: float) -> None:
    """Wait until none of these processes runs.

    A zombie runs no more: who is to collect it may take its time, or never do it, as the first
    process of many containers.
    """
    deadline = time.monotonic() + patience_s
    while any(map(_runs, processes)) and time.monotonic() < deadline:
        time.sleep(0.01)


def _runs(process: psutil.Process) -> bool:
    try:
        # The first thread can be a zombie while others still end, and with them their locks.
        return process.is_running() and (
            process.status() != psutil.STATUS_ZOMBIE or process.num_threads() > 1
        )
    except psutil.NoSuchProcess:
        return False


def remove_dead_segments(since_s: float = 0.0) -> list[str]:
    """Remove the middleware's shared memory whose owners are dead.

    Fast DDS holds a lock on ``NAME_el`` as long as a participant uses the segment NAME; a lock
    that can be taken therefore belongs to nobody. A segment that has lost its lock file is dead
    if no process maps it. Segments of the living are never touched.

    Args:
        since_s: only what was made after this time (seconds since the epoch) is removed.

    Returns:
        The names of the segments that were removed.
    """
    removed = []
    for lock in sorted(SHARED_MEMORY.glob("fast*_el")):
        with contextlib.suppress(OSError):
            if not _ours(lock, since_s):
                continue
            with lock.open("rb") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                removed += _remove(lock.with_name(lock.name.removesuffix("_el")))
    orphans = [
        each
        for each in SHARED_MEMORY.glob("fast*")
        if not each.name.endswith(_LOCKS) and not each.with_name(f"{each.name}_el").exists()
    ]
    if orphans:
        mapped = _mapped()
        for orphan in orphans:
            with contextlib.suppress(OSError):
                if _ours(orphan, since_s) and str(orphan) not in mapped:
                    removed += _remove(orphan)
    return removed


def _ours(file: Path, since_s: float) -> bool:
    status = file.stat()
    return status.st_uid == os.getuid() and status.st_mtime >= since_s


def _remove(segment: Path) -> list[str]:
    mutex = segment.with_name(f"sem.{segment.name}_mutex")
    for each in (segment, mutex, segment.with_name(f"{segment.name}_el")):
        each.unlink(missing_ok=True)
    return [segment.name]


def _mapped() -> set[str]:
    """The files in shared memory that some process maps."""
    found: set[str] = set()
    for process in psutil.process_iter():
        with contextlib.suppress(OSError):
            for line in Path(f"/proc/{process.pid}/maps").read_text().splitlines():
                path = line.partition("/")[2]
                if path.startswith("dev/shm/"):
                    found.add(f"/{path}")
    return found


def segments() -> list[str]:
    """The names of the middleware's files in shared memory, whoever owns them."""
    names = [each.name for pattern in _SEGMENTS for each in SHARED_MEMORY.glob(pattern)]
    return sorted(names)


def clean_up(run_id: str, sessions: Iterable[int], *, grace_s: float, since_s: float) -> list[str]:
    """End the processes of a run, then remove the segments that they leave. Returns the killed."""
    killed = end_all(run_id, sessions, grace_s)
    deadline = time.monotonic() + 1.0
    # The kernel frees the locks of a killed process a moment after the process is gone.
    while remove_dead_segments(since_s) and time.monotonic() < deadline:
        time.sleep(0.05)
    return killed
