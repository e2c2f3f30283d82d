"""Processes of a run that have lost their parent: daemons, and children of programs that ended.

The kernel gives them to the first process of the machine, so they are no descendants of anything
that the run started. They still carry the run's id in their environment, or are in the session of a
process of the run. Without them, their processor time would count as that of other programs.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Collection, Mapping
from pathlib import Path

import psutil

from r2bspec.ipc.protocol import RUN_ID_VARIABLE

_PROC = Path("/proc")


class OrphanTracker:
    """Finds orphans at each sample, and adds up their use by the process to which they belong.

    The environment of a process is read once, so that a look at a machine with hundreds of
    processes costs little more than a list of their numbers.
    """

    def __init__(self, run_id: str) -> None:
        """Create a tracker; without a `run_id` it finds nothing."""
        self._wanted = f"{RUN_ID_VARIABLE}={run_id}".encode() if run_id else b""
        self._examined: set[int] = {os.getpid()}
        self._ours: dict[int, psutil.Process] = {}
        self._owners: dict[int, int] = {}
        self._last_s: dict[int, float] = {}
        self._ended_s: dict[int, float] = {}

    def use(
        self, families: Mapping[int, Collection[int]], roots: Mapping[int, int], unowned: int
    ) -> dict[int, tuple[float, int]]:
        """CPU seconds so far, and resident bytes now, of the orphans of each process.

        Args:
            families: the numbers of processes, each with the pids of itself and its descendants.
            roots: the pid of each of these processes to its number.
            unowned: the number for orphans of which it is unknown whose they are.
        """
        if not self._wanted:
            return {}
        known = {pid: number for number, pids in families.items() for pid in pids}
        self._owners |= known
        self._find(known)
        found: dict[int, tuple[float, int]] = {
            number: (cpu_s, 0) for number, cpu_s in self._ended_s.items()
        }
        for pid, process in [*self._ours.items()]:
            if pid in known:
                self._forget(pid)
                continue
            number = self._owner(pid, roots, unowned)
            try:
                cpu_s, resident = _use_of(process)
                self._last_s[pid] = cpu_s
            except psutil.Error:
                cpu_s, resident = self._last_s.get(pid, 0.0), 0
                self._ended_s[number] = self._ended_s.get(number, 0.0) + cpu_s
                self._forget(pid)
            before_s, before = found.get(number, (0.0, 0))
            found[number] = (before_s + cpu_s, before + resident)
        return found

    def _find(self, known: Mapping[int, int]) -> None:
        """Examine the processes that are new since the last look."""
        running = {int(name) for name in os.listdir(_PROC) if name.isdigit()}  # noqa: PTH208
        self._examined &= running
        kept = running | self._ours.keys()
        self._owners = {pid: owner for pid, owner in self._owners.items() if pid in kept}
        for pid in running - self._ours.keys() - known.keys():
            was_ours = pid in self._owners
            if pid in self._examined and not was_ours:
                continue
            if was_ours or self._has_run_id(pid):
                with contextlib.suppress(psutil.Error):
                    process = psutil.Process(pid)
                    # Just born, and its time will be that of its parent: not an orphan yet.
                    if process.ppid() in known:
                        continue
                    self._ours[pid] = process
            self._examined.add(pid)

    def _has_run_id(self, pid: int) -> bool:
        try:
            return self._wanted in (_PROC / str(pid) / "environ").read_bytes().split(b"\0")
        except OSError:
            return False

    def _owner(self, pid: int, roots: Mapping[int, int], unowned: int) -> int:
        owner = self._owners.get(pid)
        if owner is None:
            with contextlib.suppress(OSError):
                owner = roots.get(os.getsid(pid))
        if owner is None or owner not in roots.values():
            return unowned
        self._owners[pid] = owner
        return owner

    def _forget(self, pid: int) -> None:
        self._ours.pop(pid, None)
        self._last_s.pop(pid, None)


def _use_of(process: psutil.Process) -> tuple[float, int]:
    """CPU seconds, with those of its ended children, and resident bytes of one process.

    Raises:
        psutil.Error: it has ended.
    """
    with process.oneshot():
        if process.status() == psutil.STATUS_ZOMBIE:
            raise psutil.NoSuchProcess(process.pid)
        times = process.cpu_times()
        cpu_s = times.user + times.system + times.children_user + times.children_system
        return cpu_s, process.memory_info().rss
