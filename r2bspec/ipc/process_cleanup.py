"""Ending the processes of a run, and removing what they leave in shared memory.

A process belongs to a run if it is in a session that the run opened, or carries the run's id in its
environment: the first finds every descendant that stayed, the second those that opened a session of
their own.

The number of a session alone ends no process, because the kernel uses it again. It keeps a number
for as long as a process has it, or is in the session or group of that number. The process that
opened a session keeps it until its parent collects it. So a session of the number S is the run's

- while its first process is the one that the run started, by its start time, or
- while it has a process that started before the first one was collected: such a process cannot
  have entered a session that was opened later.

A session whose processes are all gone has neither, and so is no longer the run's.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import psutil

from r2bspec.ipc.protocol import RUN_ID_VARIABLE
from r2bspec.middleware.middleware import middleware_of

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class ProcessSession:
    """A session that was opened by a process of the run.

    Attributes:
        pid: the number of the session and of its first process.
        started: when that process started, in clock ticks since boot.
        held: when that process surely still had its number, in clock ticks since boot; None if it
            has it now, because it has not been collected.
    """

    pid: int
    started: int
    held: int | None = None

    @classmethod
    def of(cls, pid: int) -> Self:
        """Return the session of a process that has opened one and has not been collected."""
        return cls(pid, start_ticks(pid) or 0)

    def is_shown_by(self, members: Iterable[int]) -> bool:
        """Return True if processes in a session of this number show that it is still the same."""
        first = start_ticks(self.pid)
        if first is not None:
            return first == self.started
        until = now_ticks() if self.held is None else self.held
        starts = (start_ticks(member) for member in members)
        return any(start is not None and start < until for start in starts)


class SessionLeader(subprocess.Popen[bytes]):
    """A process in a session of its own, with the time until which it had its number."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        self._held: int | None = None
        super().__init__(*args, **settings | {"start_new_session": True})
        self._started = start_ticks(self.pid) or 0

    def poll(self) -> int | None:
        """Poll like `subprocess.Popen.poll`."""
        if self.returncode is not None:
            return self.returncode
        before = now_ticks()
        status = super().poll()
        if status is not None:
            self._held = before
        return status

    @property
    def session(self) -> ProcessSession:
        """The id of the session that it opened."""
        return ProcessSession(self.pid, self._started, self._held)


def now_ticks() -> int:
    """Return the time since boot, in clock ticks."""
    return int(time.clock_gettime(time.CLOCK_BOOTTIME) * _TICKS_PER_S)


def start_ticks(pid: int) -> int | None:
    """Return when a process started, in clock ticks since boot; None if there is none."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(errors="replace")
    except OSError:
        return None
    # The name is in parentheses and may contain any character; the start is the 22nd field.
    return int(text.rpartition(")")[2].split()[19])


_MAX_CLEANUP_S = 2.0
_EMPTY_SCANS = 3
"""For how long segments are removed at most, and how often none may be found in a row before."""


def run_processes(run_id: str, sessions: Iterable[ProcessSession]) -> list[psutil.Process]:
    """Return every living process of a run, except the calling process."""
    sessions_by_pid = {known_session.pid: known_session for known_session in sessions}
    members: dict[int, list[psutil.Process]] = {pid: [] for pid in sessions_by_pid}
    marked: list[psutil.Process] = []
    for process in psutil.process_iter():
        if process.pid == os.getpid():
            continue
        with contextlib.suppress(psutil.Error, OSError):
            if not _is_running(process):
                continue
            number = os.getsid(process.pid)
            if number in sessions_by_pid:
                members[number].append(process)
            if carries_run_id(process.pid, run_id):
                marked.append(process)
    processes = {listed.pid: listed for listed in marked}
    for pid, session in sessions_by_pid.items():
        pids = [member.pid for member in members[pid]]
        # A process of the run that is in the session shows that it has been there all along.
        if processes.keys() & pids or session.is_shown_by(pids):
            processes |= {member.pid: member for member in members[pid]}
    return list(processes.values())


def carries_run_id(pid: int, run_id: str) -> bool:
    """Return True if a process has the id of a run in its environment.

    False if the environment cannot be read.
    """
    try:
        variables = Path(f"/proc/{pid}/environ").read_bytes() if run_id else b""
    except OSError:
        return False
    return f"{RUN_ID_VARIABLE}={run_id}".encode() in variables.split(b"\0")


def kill_process_groups(sessions: Iterable[ProcessSession]) -> None:
    """Kill the remaining processes of the first process group of each session."""
    session_list = list(sessions)
    groups = {each.pid for each in session_list}
    for process in run_processes("", session_list):
        with contextlib.suppress(psutil.Error, OSError):
            if os.getpgid(process.pid) in groups:
                process.kill()


def end_run_processes(run_id: str, sessions: Iterable[ProcessSession], grace_s: float) -> list[str]:
    """End every process of a run: SIGTERM, `grace_s` seconds, then SIGKILL until none is left.

    Returns:
        The names of the processes that had to be killed.
    """
    session_list = list(sessions)
    remaining = run_processes(run_id, session_list)
    for process in remaining:
        # psutil compares the start time first: a number that was used again is not signalled.
        with contextlib.suppress(psutil.Error):
            process.terminate()
    _wait_for(remaining, grace_s)
    killed: list[str] = []
    # A process may fork while it is being killed, so look again until none is found.
    for _ in range(20):
        remaining = run_processes(run_id, session_list)
        if not remaining:
            break
        for process in remaining:
            with contextlib.suppress(psutil.Error):
                killed.append(process.name())
                process.kill()
        _wait_for(remaining, 1.0)
    return killed


def _wait_for(processes: list[psutil.Process], timeout_s: float) -> None:
    """Wait until none of these processes runs.

    A zombie runs no more: who is to collect it may take its time, or never do it, as the first
    process of many containers.
    """
    deadline = time.monotonic() + timeout_s
    while any(map(_is_running, processes)) and time.monotonic() < deadline:
        time.sleep(0.01)


def _is_running(process: psutil.Process) -> bool:
    try:
        # The first thread can be a zombie while others still end, and with them their locks.
        return process.is_running() and (
            process.status() != psutil.STATUS_ZOMBIE or process.num_threads() > 1
        )
    except psutil.NoSuchProcess:
        return False


def clean_up(
    run_id: str, sessions: Iterable[ProcessSession], *, grace_s: float, since_s: float
) -> list[str]:
    """End the processes of a run, then remove what they leave in shared memory.

    Returns:
        The names of the processes that had to be killed.
    """
    killed = end_run_processes(run_id, sessions, grace_s)
    middleware = middleware_of(os.environ)
    if not middleware.uses_shared_memory:
        return killed
    # The kernel frees the locks of a killed process a moment after the process is gone, and other
    # runs that clean up at the same time hold some for a moment.
    idle = 0
    deadline = time.monotonic() + _MAX_CLEANUP_S
    while idle < _EMPTY_SCANS and time.monotonic() < deadline:
        idle = 0 if middleware.remove_dead_shm_files(since_s=since_s) else idle + 1
        time.sleep(0.03)
    return killed
