"""What dead runs have left behind, and its removal."""

from __future__ import annotations

import contextlib
import shutil
from dataclasses import dataclass
from pathlib import Path

from r2bspec.doctor.checkup import CheckResult, System
from r2bspec.doctor.dead_shm_files import DeadShmFile, dead_shm_files, remove_dead_shm_files
from r2bspec.doctor.run_processes import Process, find_runs
from r2bspec.doctor.scratch_folders import abandoned_scratch, unfinished_datasets
from r2bspec.ipc.process_cleanup import Session, end_run_processes, now_ticks
from r2bspec.measure.units import show

TOPIC = "runs"

_CLEAN = "r2bspec doctor --clean"
_GRACE_S = 2.0
_MAX_NAMED = 3


@dataclass(frozen=True)
class Leftovers:
    """Everything found, and how many runs live."""

    living: int
    orphans: tuple[Process, ...]
    segments: tuple[DeadShmFile, ...]
    folders: tuple[Path, ...]


def find_leftovers(system: System, cache: Path | None = None) -> Leftovers:
    """Look; nothing is changed."""
    runs = find_runs(system)
    return Leftovers(
        living=len(runs.living),
        orphans=runs.orphans,
        segments=tuple(dead_shm_files(system)),
        folders=(*abandoned_scratch(system, runs.living), *unfinished_datasets(cache)),
    )


def check_leftovers(system: System, cache: Path | None = None) -> list[CheckResult]:
    """Runs in progress, and what dead ones have left."""
    found = find_leftovers(system, cache)
    return [_living(found), _orphans(found), _segments(found), _folders(found)]


def clean(system: System, cache: Path | None = None) -> list[str]:
    """Remove what dead runs have left; says what was removed, a line each."""
    seen = now_ticks()
    found = find_leftovers(system, cache)
    removed = []
    for run_id in sorted({each.run_id for each in found.orphans}):
        of_run = [each for each in found.orphans if each.run_id == run_id]
        sessions = [
            Session(each.pid, each.started, seen) for each in of_run if each.session == each.pid
        ]
        end_run_processes(run_id, sessions, _GRACE_S)
        removed += [f"process {each.pid} ({each.name}) of run {run_id}" for each in of_run]
    for folder in found.folders:
        with contextlib.suppress(OSError):
            shutil.rmtree(folder)
            removed.append(f"folder {folder}")
    # Last: the segments of processes that were just ended are dead only now.
    removed += [f"segment {name}" for name in remove_dead_shm_files(system)]
    return removed


def _living(found: Leftovers) -> CheckResult:
    return CheckResult(
        topic=TOPIC,
        name="in progress",
        status="warn" if found.living else "ok",
        found=f"{found.living}" if found.living else "none",
        advice="runs at the same time disturb each other" if found.living else "",
        data={"living": found.living},
    )


def _orphans(found: Leftovers) -> CheckResult:
    shown = [f"{each.name} ({each.pid})" for each in found.orphans]
    return CheckResult(
        topic=TOPIC,
        name="lost processes",
        status="problem" if shown else "ok",
        found=_shortened(shown),
        advice=f"their runs are dead, yet they take processor time; {_CLEAN}" if shown else "",
        data={"pids": [each.pid for each in found.orphans]},
    )


def _segments(found: Leftovers) -> CheckResult:
    size = sum(each.bytes for each in found.segments)
    shown = [each.name for each in found.segments]
    return CheckResult(
        topic=TOPIC,
        name="dead segments",
        status="warn" if shown else "ok",
        found=f"{show(size, 'B')} in {len(shown)}" if shown else "none",
        advice=f"shared memory of ROS programs that were killed; {_CLEAN}" if shown else "",
        data={"bytes": size, "names": shown},
    )


def _folders(found: Leftovers) -> CheckResult:
    shown = [str(each) for each in found.folders]
    return CheckResult(
        topic=TOPIC,
        name="scratch folders",
        status="warn" if shown else "ok",
        found=_shortened(shown),
        advice=f"of runs that were killed; {_CLEAN}" if shown else "",
        data={"paths": shown},
    )


def _shortened(names: list[str]) -> str:
    if not names:
        return "none"
    more = f" and {len(names) - _MAX_NAMED} more" if len(names) > _MAX_NAMED else ""
    return ", ".join(names[:_MAX_NAMED]) + more
