"""Which runs live, and which processes of runs have lost their controller.

Every process of a run carries the run's id in its environment. A run lives as long as its
watchdog does: the watchdog outlives the controller by the seconds that it needs to end the rest.
Only where both were killed do processes stay.
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
"""How the programs are called that can be a controller. A parent of another name, such as the
first process of a system or container, has adopted an orphan."""


@dataclass(frozen=True)
class Process:
    """A living process, as far as it concerns runs; `run_id` is empty for one of no run.

    `started` is when it did, in clock ticks since boot.
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
        """The run that this process is the watchdog of, or nothing."""
        if _WATCHDOG not in self.argv:
            return ""
        after = self.argv[self.argv.index(_WATCHDOG) + 1 :]
        return after[0] if after else ""


@dataclass(frozen=True)
class RunProcesses:
    """All runs that processes tell of: the ids that live, and the orphans of those that do not."""

    living: frozenset[str]
    orphans: tuple[Process, ...]


def find_runs(system: System) -> RunProcesses:
    """Look at every process that may be looked at.

    The run that this process is itself a part of is never taken for dead.
    """
    processes = {each.pid: each for each in _processes(system.proc)}
    living = {each.watched_run for each in processes.values()} - {""}
    living |= {system.environ.get(RUN_ID_VARIABLE, "")} - {""}
    for each in processes.values():
        parent = processes.get(each.parent)
        if each.run_id and parent and not parent.run_id and parent.name.startswith(_CONTROLLERS):
            # Its watchdog was killed, but the controller is there.
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
        # The name stands in parentheses and may hold any character, these included.
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
