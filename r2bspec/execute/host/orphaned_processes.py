"""Processes of a run whose parents have ended: daemons, and what a launcher leaves behind.

No process of the run is their parent any more, so they are in no tree of descendants. They carry
the id of the run in their environment, which every process inherits and which is read once for each
process of the machine.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import psutil

from r2bspec.ipc.protocol import RUN_ID_VARIABLE

_PROC: Final = Path("/proc")


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
