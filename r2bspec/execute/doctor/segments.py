"""Shared-memory segments of the middleware whose owners are dead."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
from dataclasses import dataclass
from pathlib import Path

from r2bspec.execute.doctor.model import System

_LOCKS = ("_el", "_sl")


@dataclass(frozen=True)
class Segment:
    """A segment, or what is left of one, with the bytes of memory that it takes."""

    name: str
    bytes: int


def dead_segments(system: System) -> list[Segment]:
    """This user's segments that nobody uses; nothing is changed.

    A participant holds a lock on ``NAME_el`` as long as it uses the segment NAME. One without a
    lock file is dead if no process maps it, as `r2bspec.harness.reaping.remove_dead_segments`
    has it, which removes them.
    """
    memory = system.shared_memory
    files = [each for each in memory.glob("fast*") if not each.name.endswith(_LOCKS)]
    named = {each.name for each in files}
    # A lock may be all that is left.
    named |= {each.name.removesuffix("_el") for each in memory.glob("fast*_el")}
    mapped: set[str] | None = None
    dead = []
    for name in sorted(named):
        lock = memory / f"{name}_el"
        with contextlib.suppress(OSError):
            if lock.exists():
                free = _is_mine(lock) and _is_free(lock)
            else:
                mapped = _mapped(system) if mapped is None else mapped
                free = _is_mine(memory / name) and name not in mapped
            if free:
                dead.append(Segment(name, _bytes(memory / name)))
    return dead


def _is_mine(file: Path) -> bool:
    return file.stat().st_uid == os.getuid()


def _is_free(lock: Path) -> bool:
    with lock.open("rb") as file:
        try:
            # Shared, so that two who look at the same time do not see each other.
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True


def _bytes(segment: Path) -> int:
    """What it takes of the memory: its blocks, since a segment is sparse until it is written."""
    try:
        return segment.stat().st_blocks * 512
    except OSError:
        return 0


def _mapped(system: System) -> set[str]:
    """The names of segments that some process maps."""
    found: set[str] = set()
    pattern = re.compile(rf"{re.escape(str(system.shared_memory))}/(fast\S+)")
    for maps in system.proc.glob("[0-9]*/maps"):
        with contextlib.suppress(OSError):
            found.update(pattern.findall(maps.read_text(errors="replace")))
    return found
