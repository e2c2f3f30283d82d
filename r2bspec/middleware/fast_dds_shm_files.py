"""Segments of Fast DDS in shared memory: which of them no process uses, and their removal.

Fast DDS holds a lock on ``NAME_el`` as long as a participant uses the segment NAME; if the lock can
be taken, no participant does. A segment that has lost its lock file is dead if no process
maps it. Segments of the living, and those of other users, are never touched.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import stat
from collections.abc import Iterable
from pathlib import Path

from r2bspec.middleware.middleware import PROC, SHARED_MEMORY

_OTHERS = 0o077

_LOCKS = ("_el", "_sl")
_FILES = ("fastrtps_*", "fastdds_*", "sem.fastrtps_*", "sem.fastdds_*")


def shm_files(memory: Path = SHARED_MEMORY) -> list[str]:
    """The names of the middleware's files in shared memory, whoever owns them."""
    return sorted(each.name for pattern in _FILES for each in memory.glob(pattern))


def dead_shm_files(
    memory: Path = SHARED_MEMORY, proc: Path = PROC, since_s: float = 0.0
) -> list[str]:
    """The names of this user's segments that nobody uses; nothing is changed.

    Args:
        memory: the folder of shared memory.
        proc: the folder of processes.
        since_s: only what was made after this time counts (seconds since the epoch).
    """
    # A lock may be all that is left of a segment.
    names = {each.name.removesuffix("_el") for each in memory.glob("fast*")}
    mapped: set[str] | None = None
    dead = []
    for name in sorted(each for each in names if not each.endswith(_LOCKS)):
        lock = _lock(memory, name)
        with contextlib.suppress(OSError):
            if lock.exists():
                free = _ours(lock, since_s) and _is_free(lock)
            elif _ours(memory / name, since_s):
                mapped = _mapped(memory, proc) if mapped is None else mapped
                free = name not in mapped
            else:
                free = False
            if free:
                dead.append(name)
    return dead


def remove_dead_shm_files(
    memory: Path = SHARED_MEMORY, proc: Path = PROC, since_s: float = 0.0
) -> list[str]:
    """Remove the segments that `dead_shm_files` finds; returns their names."""
    removed = []
    for name in dead_shm_files(memory, proc, since_s):
        with contextlib.suppress(OSError), contextlib.ExitStack() as held:
            if _lock(memory, name).exists():
                # Held until all is gone, so that nobody takes up what is being removed.
                file = held.enter_context(_lock(memory, name).open("rb"))
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for each in (memory / name, memory / f"sem.{name}_mutex", _lock(memory, name)):
                each.unlink(missing_ok=True)
            removed.append(name)
    return removed


def readable_shm_files(memory: Path = SHARED_MEMORY) -> list[str]:
    """The names of this user's files that other users may read."""
    found = []
    for name in shm_files(memory):
        with contextlib.suppress(OSError):
            status = (memory / name).lstat()
            readable = stat.S_ISREG(status.st_mode) and status.st_mode & _OTHERS
            if readable and status.st_uid == os.geteuid():
                found.append(name)
    return found


def make_shm_files_private(
    pids: Iterable[int], memory: Path = SHARED_MEMORY, proc: Path = PROC
) -> None:
    """Take all rights to the segments of some processes from other users.

    Fast DDS gives them the mode 0644 whatever the umask.
    """
    readable = set(readable_shm_files(memory))
    if not readable:
        return
    pattern = _mapped_pattern(memory)
    for pid in pids:
        with contextlib.suppress(OSError):
            maps = (proc / str(pid) / "maps").read_text(errors="replace")
            for name in readable.intersection(pattern.findall(maps)):
                _make_private(memory / name)


def _make_private(file: Path) -> None:
    descriptor = os.open(file, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        if os.fstat(descriptor).st_uid == os.geteuid():
            os.fchmod(descriptor, 0o600)
    finally:
        os.close(descriptor)


def _lock(memory: Path, name: str) -> Path:
    return memory / f"{name}_el"


def _ours(file: Path, since_s: float) -> bool:
    status = file.stat()
    return status.st_uid == os.getuid() and status.st_mtime >= since_s


def _is_free(lock: Path) -> bool:
    with lock.open("rb") as file:
        try:
            # Shared, so that two who look at the same time do not see each other.
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True


def _mapped(memory: Path, proc: Path) -> set[str]:
    """The names of segments that some process maps."""
    found: set[str] = set()
    pattern = _mapped_pattern(memory)
    for maps in proc.glob("[0-9]*/maps"):
        with contextlib.suppress(OSError):
            found.update(pattern.findall(maps.read_text(errors="replace")))
    return found


def _mapped_pattern(memory: Path) -> re.Pattern[str]:
    # A line that goes on with "(deleted)" is about an earlier segment of that name.
    return re.compile(rf"{re.escape(str(memory))}/((?:sem\.)?fast\S+)$", re.MULTILINE)
