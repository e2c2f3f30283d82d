"""What dead runs have left behind, and its removal.

Every process of a run has the id of the run in its environment. A run is active as long as its
watchdog runs, which ends after all other processes. Processes are left only if both controller and
watchdog were killed. Dead runs may also leave segments of shared memory and scratch folders.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Iterator, Set
from dataclasses import dataclass
from pathlib import Path

from r2bspec.diagnostics.quote import first_words
from r2bspec.doctor.checkup import CheckResult, System, advised
from r2bspec.ipc.process_cleanup import ProcessSession, end_run_processes, now_ticks
from r2bspec.ipc.protocol import RUN_ID_VARIABLE
from r2bspec.middleware.middleware import known_middlewares
from r2bspec.safe_io.private_files import remove_folder

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
        """The run of which this process is the watchdog; empty if it is no watchdog."""
        if _WATCHDOG not in self.argv:
            return ""
        after = self.argv[self.argv.index(_WATCHDOG) + 1 :]
        return after[0] if after else ""


def find_runs(system: System) -> tuple[frozenset[str], tuple[Process, ...]]:
    """Return the ids of active runs, and orphaned processes of other runs of this user.

    The run to which this process itself belongs counts as active.
    """
    processes = {found_process.pid: found_process for found_process in _processes(system.proc)}
    living = {candidate.watched_run for candidate in processes.values()} - {""}
    living |= {system.environ.get(RUN_ID_VARIABLE, "")} - {""}
    for marked in processes.values():
        parent = processes.get(marked.parent)
        if marked.run_id and parent and not parent.run_id and parent.name.startswith(_CONTROLLERS):
            # Its watchdog was killed, but the controller still runs.
            living.add(marked.run_id)
    orphans = [
        candidate
        for candidate in processes.values()
        if candidate.run_id and candidate.run_id not in living
    ]
    return frozenset(living), tuple(sorted(orphans, key=lambda each: each.pid))


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
            run_id=_run_of_process(folder),
            started=int(fields[_START_FIELD]),
        )


def _run_of_process(folder: Path) -> str:
    """Return the run of a process of this user.

    What others run is not ours to judge, nor to end.
    """
    try:
        if folder.stat().st_uid != os.geteuid():
            return ""
        variables = (folder / "environ").read_bytes().split(b"\0")
    except OSError:
        return ""
    prefix = f"{RUN_ID_VARIABLE}=".encode()
    values = [
        variable.removeprefix(prefix) for variable in variables if variable.startswith(prefix)
    ]
    return values[0].decode(errors="replace") if values else ""


def dead_shm_files(system: System) -> list[str]:
    """Return this user's segments of any middleware that no process uses; changes nothing."""
    return [
        name
        for middleware in known_middlewares()
        for name in middleware.dead_shm_files(system.shared_memory, system.proc)
    ]


def remove_dead_shm_files(system: System) -> list[str]:
    """Remove unused segments, and return their names."""
    return [
        name
        for middleware in known_middlewares()
        for name in middleware.remove_dead_shm_files(system.shared_memory, system.proc)
    ]


_MIN_AGE_S = 10.0
"""A run creates its folder shortly before the processes that mark it as active."""


def abandoned_scratch(system: System, living: Set[str]) -> list[Path]:
    """Return the scratch folders of ended runs; `system.runs` is a folder of runs or a run."""
    folders = [*system.runs.glob("*/.scratch-*"), *system.runs.glob(".scratch-*")]
    return sorted(
        folder
        for folder in folders
        if _is_old(folder) and _run_of_folder(folder.parent) not in living
    )


def _is_old(folder: Path) -> bool:
    try:
        return time.time() - folder.stat().st_mtime > _MIN_AGE_S
    except OSError:
        return False


def _run_of_folder(folder: Path) -> str:
    """Return the run of a folder; empty if its record cannot be read."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        return str(json.loads((folder / "record.json").read_bytes())["run_id"])
    return ""


_RUNS = "runs"

_CLEAN = "r2bspec doctor --clean"
_GRACE_S = 2.0
_MAX_NAMED = 3


@dataclass(frozen=True)
class Leftovers:
    """All leftovers, and the ids of the living runs."""

    living: frozenset[str]
    orphans: tuple[Process, ...]
    segments: tuple[str, ...]
    folders: tuple[Path, ...]


def find_leftovers(system: System) -> Leftovers:
    """Find the leftovers of dead runs; changes nothing."""
    living, orphans = find_runs(system)
    folders = tuple(abandoned_scratch(system, living))
    return Leftovers(living, orphans, tuple(dead_shm_files(system)), folders)


def check_leftovers(system: System) -> list[CheckResult]:
    """Check for runs in progress, and for leftovers of dead runs."""
    leftovers = find_leftovers(system)
    return [_living(leftovers), _orphans(leftovers), _segments(leftovers), _folders(leftovers)]


def clean(system: System) -> list[str]:
    """Remove the leftovers of dead runs, and return a line for each of them."""
    seen = now_ticks()
    leftovers = find_leftovers(system)
    removed = []
    for run_id in sorted({orphan.run_id for orphan in leftovers.orphans}):
        of_run = [orphan for orphan in leftovers.orphans if orphan.run_id == run_id]
        sessions = [
            ProcessSession(process.pid, process.started, seen)
            for process in of_run
            if process.session == process.pid
        ]
        end_run_processes(run_id, sessions, _GRACE_S)
        removed += [f"process {process.pid} ({process.name}) of run {run_id}" for process in of_run]
    for folder in leftovers.folders:
        with contextlib.suppress(OSError):
            remove_folder(folder)
            removed += [f"folder {folder}"] * (not folder.exists())
    # Last: the segments of processes that were just ended are dead only now.
    removed += [f"segment {name}" for name in remove_dead_shm_files(system)]
    return removed


def _living(found: Leftovers) -> CheckResult:
    living = len(found.living)
    advice = "runs at the same time disturb each other" if living else ""
    return advised(_RUNS, "in progress", str(living or "none"), advice, {"living": living})


def _orphans(found: Leftovers) -> CheckResult:
    shown = [f"{orphan.name} ({orphan.pid})" for orphan in found.orphans]
    advice = f"their runs are dead, yet they take processor time; {_CLEAN}" if shown else ""
    data = {"pids": [orphan.pid for orphan in found.orphans]}
    text = _shortened(shown)
    return advised(_RUNS, "lost processes", text, advice, data, otherwise="problem")


def _segments(found: Leftovers) -> CheckResult:
    shown = list(found.segments)
    advice = f"shared memory of ROS programs that were killed; {_CLEAN}" if shown else ""
    return advised(_RUNS, "dead segments", _shortened(shown), advice, {"names": shown})


def _folders(found: Leftovers) -> CheckResult:
    shown = [str(folder) for folder in found.folders]
    advice = f"of runs that were killed; {_CLEAN}" if shown else ""
    return advised(_RUNS, "scratch folders", _shortened(shown), advice, {"paths": shown})


def _shortened(names: list[str]) -> str:
    return first_words(names, _MAX_NAMED) or "none"
