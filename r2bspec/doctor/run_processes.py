"""Active runs, and processes of runs without a controller.

Every process of a run has the id of the run in its environment. A run is active as long as its
watchdog runs: it runs until it has ended all other processes. Processes are left only if both
controller and watchdog were killed.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from r2bspec.doctor.checkup import System
from r2bspec.ipc.protocol import RUN_ID_VARIABLE

_WATCHDOG = "r2bspec.harness.watchdog"
_START_FIELD = 19
"""Where the start time is in /proc/PID/stat, counted from the field after the name."""

_CONTROLLERS = ("python", "r2bspec", "pytest")
"""Prefixes of the names of programs that can be a controller. A parent with another name, such as
the first process of a system or container, has adopted an orphan."""


@dataclass(frozen=True)
class Process:
    """A running process; `run_id` is empty if it does not belong to a run.

    `started` is its start time, in clock ticks since boot.
    """

    pid: int
    parent: int
    session: int
    name: str
    argv: tuple[str, ...]
    run_id: str
    started: int

    @property
    def watched_run(self) -> str:
        """The run of which this process is the watchdog; empty if it is none."""
        if _WATCHDOG not in self.argv:
            return ""
        after = self.argv[self.argv.index(_WATCHDOG) + 1 :]
        return after[0] if after else ""


@dataclass(frozen=True)
class RunProcesses:
    """The ids of active runs, and the orphaned processes of others."""

    living: frozenset[str]
    orphans: tuple[Process, ...]


def find_runs(system: System) -> RunProcesses:
    """Find the runs of all processes that this user may inspect.

    The run to which this process itself belongs counts as active.
    """
    processes = {each.pid: each for each in _processes(system.proc)}
    living = {each.watched_run for each in processes.values()} - {""}
    living |= {system.environ.get(RUN_ID_VARIABLE, "")} - {""}
    for each in processes.values():
        parent = processes.get(each.parent)
        if each.run_id and parent and not parent.run_id and parent.name.startswith(_CONTROLLERS):
            # Its watchdog was killed, but the controller still runs.
            living.add(each.run_id)
    orphans = [each for each in processes.values() if each.run_id and each.run_id not in living]
    return RunProcesses(frozenset(living), tuple(sorted(orphans, key=lambda each: each.pid)))


def _processes(proc: Path) -> Iterator[Process]:
    for folder in proc.glob("[0-9]*"):
        try:
            status = (folder / "stat").read_text(errors="replace")
            argv = (folder / "cmdline").read_bytes()
        except OSError:
            continue
        # The name is in parentheses and may contain any character, including parentheses.
        head, _, rest = status.rpartition(")")
        fields = rest.split()
        state, parent, _group, session = fields[:4]
        if state in {"Z", "X"}:
            continue
        yield Process(
            pid=int(folder.name),
            parent=int(parent),
            session=int(session),
            name=head.partition("(")[2],
            argv=tuple(argv.decode(errors="replace").rstrip("\0").split("\0")),
            run_id=_run_id(folder),
            started=int(fields[_START_FIELD]),
        )


def _run_id(folder: Path) -> str:
    """The run of a process of this user; what others run is not ours to judge, nor to end."""
    try:
        if folder.stat().st_uid != os.geteuid():
            return ""
        variables = (folder / "environ").read_bytes().split(b"\0")
    except OSError:
        return ""
    wanted = f"{RUN_ID_VARIABLE}=".encode()
    values = [each.removeprefix(wanted) for each in variables if each.startswith(wanted)]
    return values[0].decode(errors="replace") if values else ""
