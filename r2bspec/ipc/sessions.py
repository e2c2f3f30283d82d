"""Sessions that a run has opened, and how they are told from later ones of the same number.

The kernel keeps a number for as long as a process has it, or is in the session or group of that
number. The process that opened a session keeps it until its parent collects it. So a session of
the number S is the run's

- while its first process is the one that the run started, by its start time, or
- while it has a process that started before the first one was collected: such a process cannot
  have entered a session that was opened later.

A session whose processes are all gone has neither, and so is no longer the run's.
"""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Session:
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
        """The session of a process that has opened one and has not been collected."""
        return cls(pid, start_ticks(pid) or 0)

    def is_shown_by(self, members: Iterable[int]) -> bool:
        """Whether processes in a session of this number show that it is still this one."""
        first = start_ticks(self.pid)
        if first is not None:
            return first == self.started
        until = now_ticks() if self.held is None else self.held
        starts = (start_ticks(each) for each in members)
        return any(each is not None and each < until for each in starts)


class SessionLeader(subprocess.Popen[bytes]):
    """A process in a session of its own; knows until when it had its number."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        self._held: int | None = None
        super().__init__(*args, **settings | {"start_new_session": True})
        self._started = start_ticks(self.pid) or 0

    def poll(self) -> int | None:
        """As `subprocess.Popen.poll`."""
        if self.returncode is not None:
            return self.returncode
        before = now_ticks()
        status = super().poll()
        if status is not None:
            self._held = before
        return status

    @property
    def session(self) -> Session:
        """The session that it opened."""
        return Session(self.pid, self._started, self._held)


def now_ticks() -> int:
    """The time since boot, in clock ticks."""
    return int(time.clock_gettime(time.CLOCK_BOOTTIME) * _TICKS_PER_S)


def start_ticks(pid: int, proc: Path = Path("/proc")) -> int | None:
    """When a process started, in clock ticks since boot; None if there is none."""
    try:
        text = (proc / str(pid) / "stat").read_text(errors="replace")
    except OSError:
        return None
    # The name is in parentheses and may contain any character; the start is the 22nd field.
    return int(text.rpartition(")")[2].split()[19])
