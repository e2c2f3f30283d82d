"""Shared-memory segments of the middleware whose owners are dead, and what they take."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from r2bspec.doctor.checkup import System
from r2bspec.middleware.rmw_registry import known_middlewares


@dataclass(frozen=True)
class DeadShmFile:
    """A segment, or what is left of one, with the bytes of memory that it takes."""

    name: str
    bytes: int


def dead_shm_files(system: System) -> list[DeadShmFile]:
    """This user's segments that no process uses, of any middleware; nothing is changed."""
    memory = system.shared_memory
    return [
        DeadShmFile(name, _bytes(memory / name))
        for each in known_middlewares()
        for name in each.dead_shm_files(memory, system.proc)
    ]


def remove_dead_shm_files(system: System) -> list[str]:
    """Remove them; returns their names."""
    return [
        name
        for each in known_middlewares()
        for name in each.remove_dead_shm_files(system.shared_memory, system.proc)
    ]


def _bytes(segment: Path) -> int:
    """What it takes of the memory: its blocks, since a segment is sparse until it is written."""
    try:
        return segment.stat().st_blocks * 512
    except OSError:
        return 0
