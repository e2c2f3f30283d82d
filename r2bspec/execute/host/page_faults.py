"""Page faults of a process, from the kernel."""

from __future__ import annotations

from pathlib import Path

_AFTER_NAME = 2
"""The number of the first field after the name, which may itself have blanks and brackets."""

_MINOR, _MINOR_OF_CHILDREN = 9, 10
"""The places of ``minflt`` and ``cminflt`` in /proc/PID/stat, counted from 0 (see proc(5))."""


def minor_faults(pid: int) -> int:
    """The page faults that needed no disk, with those of children that have exited; 0 if unknown.

    Memory that was mapped freshly causes one for each page that is touched first, such as the
    pages of a large message whose buffer the allocator gave back before.
    """
    try:
        fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
        return sum(int(fields[each - _AFTER_NAME]) for each in (_MINOR, _MINOR_OF_CHILDREN))
    except (OSError, IndexError, ValueError):
        return 0
