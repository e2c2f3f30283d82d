"""What each process of a start does with each message, observed from inside.

An object is preloaded into them (``r2bspec/native/anatomy.c``) that writes what they call to files
of its own; after each segment, its events are taken from these. Player and monitor are observed as
the graph is: they are the ends of every path.

A run observes either all its starts (``benchmark: {anatomy: true}``), or one more start after
everything that counts (`r2bspec.execute.measurement.extra_iteration`).
"""

from __future__ import annotations

import contextlib
import os
import resource
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from r2bspec.execute.processes.prerequisites import built
from r2bspec.judge.measure.anatomy_summary import ObservedRows
from r2bspec.native.build import anatomy_environment, anatomy_object
from r2bspec.record.anatomy_files import AnatomyReader, file_bytes
from r2bspec.record.run_record import AnatomyProcess, AnatomyRecord
from r2bspec.safe_io.private_files import remove_folder, temporary_folder

if TYPE_CHECKING:
    from r2bspec.plan.plan import Plan, ProcessPlan
    from r2bspec.record.run_folder import RunFolder
    from r2bspec.record.run_record import Segment

_EVENTS = 16
"""Of one process for each message on a topic: publication, take, callback, waits and timers."""

_SEGMENTS = 4
"""Warm-up and further segments, as multiples of what the plan plays in one start."""

_FEWEST_EVENTS, _MOST_EVENTS = 100_000, 4_000_000
_EARLIER_NS = 100_000_000
"""The player is told to play this long before the first step is due, at most."""


def room_bytes(plan: Plan) -> int:
    """Return the size of the file that each process of a start gets for its events."""
    topics = len(plan.topics) + len(plan.inputs)
    steps = sum(
        max(play.rate_hz, 1.0) * play.duration_ns / 1e9 * play.iterations for play in plan.plays
    )
    expected = int(_SEGMENTS * steps / plan.starts * topics * _EVENTS)
    wanted = file_bytes(min(max(expected, _FEWEST_EVENTS), _MOST_EVENTS))
    limit, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    return wanted if limit == resource.RLIM_INFINITY else min(wanted, limit)


_FILES = "anatomy-"
_MEMORY = Path("/dev/shm")  # noqa: S108 - a folder of its own is made there


@contextlib.contextmanager
def events_folder(plan: Plan, scratch: Path) -> Iterator[Path]:
    """Return the folder to which the processes of a run write their events.

    It is in memory if there is room: a process that changes a page of a file on a disk while the
    kernel writes that page has to wait.
    """
    measured = len(plan.processes_in("measure"))
    with contextlib.ExitStack() as stack:
        folder = scratch
        with contextlib.suppress(OSError):
            room = os.statvfs(_MEMORY)
            # The middleware takes memory there, too.
            if room.f_bavail * room.f_frsize > 2 * measured * room_bytes(plan):
                folder = stack.enter_context(temporary_folder("anatomy", _MEMORY))
        yield folder


class AnatomyObservation:
    """The processes of one start, observed from inside.

    Args:
        plan: the plan of the run.
        start: its number.
        folder: below it the processes write what they do.

    Raises:
        NotInstalledError: what observes them cannot be built (R2B668).

    Attributes:
        files: the folder of this start.
        record: what was observed so far.
    """

    def __init__(self, plan: Plan, start: int, folder: Path) -> None:
        # Earlier starts have ended: their files would fill the memory.
        for earlier in folder.glob(f"{_FILES}*"):
            remove_folder(earlier)
        self.files = folder / f"{_FILES}{start}"
        self.files.mkdir()
        self.record = AnatomyRecord(start=start)
        self._plan, self._start = plan, start
        self._preload, self._room_bytes = built(anatomy_object), room_bytes(plan)
        self._reader = AnatomyReader(self.files)

    def environment(self, process: ProcessPlan, variables: Mapping[str, str]) -> dict[str, str]:
        """Return the environment of a process, with the observer preloaded if the plan wants it."""
        if not self._plan.observes(process):
            return dict(variables)
        preloaded, room = variables.get("LD_PRELOAD", ""), self._room_bytes
        return {
            **variables,
            **anatomy_environment(self._preload, self.files, process.name, room, preloaded),
        }

    def store(self, segment: Segment, until_ns: int, folder: RunFolder) -> ObservedRows:
        """Store the events of a segment in the run folder, and describe them in the record.

        Raises:
            RecordError: the file cannot be written.
        """
        rows, objects, processes = self._reader.read(until_ns - _EARLIER_NS)
        began_ns = rows["began_ns"]
        inside = (began_ns >= segment.began_ns - _EARLIER_NS) & (began_ns <= until_ns)
        rows = rows[inside]
        folder.write_rows("anatomy", rows, segment.id)
        self.record = AnatomyRecord(
            start=self._start,
            processes=processes,
            objects=objects,
            error=" ".join(self._missing(processes)),
        )
        return ObservedRows(rows, self.record)

    def _missing(self, processes: tuple[AnatomyProcess, ...]) -> Iterator[str]:
        """Yield what was not observed, a sentence each."""
        if self._reader.unread:
            yield f"{self._reader.unread} more processes have events; they were not read."
        lost = {process.name: process.lost for process in processes if process.lost}
        if lost:
            each = ", ".join(f"{count} of {name}" for name, count in lost.items())
            yield f"There was no room for {sum(lost.values())} events ({each}): parts are missing."
        silent = {
            process.name
            for process in self._plan.processes
            if process.phase == "measure" and process.nodes and self._plan.observes(process)
        } - {process.name for process in processes}
        if silent:
            yield (
                f"Without events of {', '.join(sorted(silent))}: if its log does not say why, it "
                "has no ROS, is linked to rcl statically, runs as another user (setuid), or "
                "replaces LD_PRELOAD."
            )
