"""Whether the shared memory of a phase fits into what is free.

A segment of the full size is taken for each process when it starts. Where that fails, the
middleware says so in the log of that process and goes on over UDP: with images the graph is then
ten times slower, and nothing tells why. A run therefore looks before it starts anything.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from r2bspec.execute.errors import SharedMemoryError
from r2bspec.measure.units import show
from r2bspec.middleware.middleware import SHARED_MEMORY, Middleware
from r2bspec.plan.plan import Plan


def require_free_shared_memory(
    plan: Plan,
    phase: str,
    middleware: Middleware,
    segment_bytes: int,
    folder: Path = SHARED_MEMORY,
) -> None:
    """See that the processes of a phase find the shared memory that they are told to use.

    A launch file counts as one process, because how many it starts is not known.

    Args:
        plan: says who runs in the phase.
        phase: ``preprocess`` or ``measure``.
        middleware: takes the segments.
        segment_bytes: the size of each segment; 0 where the run decides nothing about it.
        folder: where shared memory lies.

    Raises:
        SharedMemoryError: there is less room.
    """
    if not segment_bytes:
        return
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise SharedMemoryError(
            f"there is no shared memory in {folder}: {error.strerror or error}",
            hint="Mount a tmpfs there, or state transport: udp.",
        ) from error
    # The observer, which no plan lists, runs with the measured graph.
    processes = sum(each.phase == phase for each in plan.processes) + (phase == "measure")
    wanted = middleware.required_shm_bytes(processes, segment_bytes)
    if free < wanted:
        raise SharedMemoryError(
            f"{folder} has {show(free, 'B')} free; the {processes} processes of the {phase} phase "
            f"need {show(wanted, 'B')}, a segment of {show(segment_bytes, 'B')} each",
            hint="Make it larger (in a container: "
            f"--shm-size={_suggested_mib(wanted)}m; else: mount -o "
            f"remount,size={_suggested_mib(wanted)}m {folder}), or state transport: udp, "
            "or smaller "
            "segments (transport: {kind: shared_memory, segment: ...}). 'r2bspec doctor --clean' "
            "frees what dead runs have left.",
        )


def _suggested_mib(count: int) -> int:
    """Mebibytes with some to spare."""
    return -(-count * 5 // (4 << 20))
