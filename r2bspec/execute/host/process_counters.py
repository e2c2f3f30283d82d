"""What the kernel says of the processes of a run: who they are, and what they waited for.

Descendants are found by their parents. Processes whose parents have ended, daemons and what a
launcher leaves behind, are in no tree: they carry the id of the run in their environment, which
every process inherits and which is read once for each process of the machine.

How long a process was runnable but had no processor is counted for every thread, in the second
field of ``/proc/PID/task/TID/schedstat``, in nanoseconds: it is the time that other programs, or
other threads of the run, took from it. All counters are cumulative.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

import psutil

from r2bspec.ipc.protocol import RUN_ID_VARIABLE

_AFTER_NAME = 2
"""The number of the first field after the name, which may itself have blanks and brackets."""

_MINOR, _MINOR_OF_CHILDREN = 9, 10
"""The places of ``minflt`` and ``cminflt`` in /proc/PID/stat, counted from 0 (see proc(5))."""

_PROC: Final = Path("/proc")


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


class OrphanFinder:
    """Finds them; each is attributed to the process of the run that it descends from."""

    def __init__(self, run_id: str, proc: Path = _PROC) -> None:
        """Nothing is read yet.

        Args:
            run_id: of the run; if it is empty, nothing is ever found.
            proc: where the process file system is.
        """
        self._proc = proc
        self._wanted = f"{RUN_ID_VARIABLE}={run_id}".encode() if run_id else b""
        self._belongs: dict[int, bool] = {}
        self._owners: dict[int, int] = {}

    def find(
        self, descendants: Mapping[int, int], leaders: Mapping[int, int], unknown: int
    ) -> dict[int, int]:
        """The orphans that run now: process id to the index of the process it belongs to.

        Args:
            descendants: process id to index, of all processes of the run that have a parent in it,
                and of those that the controller started.
            leaders: process id to index, of all processes that the controller has ever started;
                each is the leader of a session.
            unknown: the index for orphans of which only the run is known.
        """
        if not self._wanted:
            return {}
        running = set(psutil.pids())
        # Numbers are used again.
        self._belongs = {pid: ours for pid, ours in self._belongs.items() if pid in running}
        self._owners = {pid: index for pid, index in self._owners.items() if pid in running}
        self._owners |= descendants
        for pid in running - self._belongs.keys():
            self._belongs[pid] = pid in descendants or self._has_run_id(pid)
        found: dict[int, int] = {}
        for pid, ours in self._belongs.items():
            if ours and pid not in descendants and pid not in leaders and pid != os.getpid():
                if pid not in self._owners:
                    self._owners[pid] = leaders.get(_session_of(pid), unknown)
                found[pid] = self._owners[pid]
        return found

    def _has_run_id(self, pid: int) -> bool:
        try:
            variables = (self._proc / str(pid) / "environ").read_bytes()
        except OSError:
            return False
        return self._wanted in variables.split(b"\0")


def _session_of(pid: int) -> int:
    try:
        return os.getsid(pid)
    except OSError:
        return -1


class RunQueueWaits:
    """The cumulative waits of groups of processes. Threads that have ended stay counted."""

    def __init__(self, proc: Path = _PROC) -> None:
        """See whether the kernel counts waits.

        Args:
            proc: where the process file system is.
        """
        self._proc = proc
        self._is_known = (proc / "self" / "schedstat").exists()
        self._last_ns: dict[tuple[int, int], int] = {}
        self._total_ns: dict[int, int] = {}

    def update(self, index: int, pids: Iterable[int]) -> float:
        """The wait of all threads of a group so far, in seconds; NaN if the kernel counts none.

        Args:
            index: of the group.
            pids: its processes that run now.
        """
        if not self._is_known:
            return math.nan
        grown_ns = sum(self._grown_ns(pid) for pid in pids)
        self._total_ns[index] = self._total_ns.get(index, 0) + grown_ns
        return self._total_ns[index] / 1e9

    def _grown_ns(self, pid: int) -> int:
        tasks = self._proc / str(pid) / "task"
        grown_ns = 0
        try:
            threads = [*tasks.iterdir()]
        except OSError:
            return 0
        for thread in threads:
            try:
                now_ns = int((thread / "schedstat").read_bytes().split()[1])
            except (OSError, ValueError, IndexError):
                continue
            key = (pid, int(thread.name))
            before_ns = self._last_ns.get(key, 0)
            # The number of a thread that has ended may be used again.
            grown_ns += now_ns - before_ns if now_ns >= before_ns else now_ns
            self._last_ns[key] = now_ns
        return grown_ns
