"""What every state of a run uses: its context, its time budget, and host interference.

Interference with a probe is determined as it ends; that with iterations when the run is judged,
from the same samples.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from r2bspec.execute.processes.resources import ResourceSampler
from r2bspec.judge.measure.host_usage import (
    HostInterference,
    ProcessSamples,
    host_interference,
    interference_reasons,
    taken_share,
)
from r2bspec.language.quantities import Duration
from r2bspec.record.sample_arrays import Rows

if TYPE_CHECKING:
    from r2bspec.execute.identity.loaded_files import LoadedFiles
    from r2bspec.execute.processes.supervisor import ProcessSupervisor
    from r2bspec.execute.states import Progress, RunStates
    from r2bspec.record.run_folder import RunFolder

MEASURE_PHASE = "measure"
"""The phase of the processes that run during the measurement."""


_SAMPLE_TIMEOUT_S = 1.0
_POLL_S = 0.005


@dataclass(frozen=True)
class Interference:
    """The interference of other programs with a part of the run.

    Attributes:
        reasons: in words, as in reports; empty if no limit was exceeded.
        taken: the largest share of the time that they can have taken from the run.
    """

    reasons: tuple[str, ...] = ()
    taken: float = 0.0


@dataclass(frozen=True)
class HostWatch:
    """Reports interference with parts of the run that have ended.

    Attributes:
        resources: samples the run and the machine.
        process_count: how many processes the run has started so far.
        machine: as in `RunRecord.machine`.
    """

    resources: ResourceSampler
    process_count: Callable[[], int]
    machine: Mapping[str, Any]

    def between(self, began_ns: int, ended_ns: int) -> Interference:
        """Return the interference between two times (CLOCK_MONOTONIC), both in the past."""
        rows = self._rows_until(ended_ns)
        used = ProcessSamples(self.resources.rows()).used(began_ns, ended_ns)
        processes, window = range(self.process_count()), (began_ns, ended_ns)
        return interference_of(host_interference(rows, used, processes, self.machine, window))

    def _rows_until(self, time_ns: int) -> Rows:
        """Return the samples, with one after this time if the sampler still runs."""
        deadline = time.monotonic() + _SAMPLE_TIMEOUT_S
        self.resources.sample_at(time.monotonic_ns())
        while True:
            rows = self.resources.interference()
            if (rows.size and rows["time_ns"][-1] >= time_ns) or time.monotonic() > deadline:
                return rows
            time.sleep(_POLL_S)


def interference_of(found: HostInterference | None) -> Interference:
    """Return the sampled interference in words and as a share."""
    reasons = interference_reasons(found)
    return Interference(reasons, taken_share(found)) if reasons else Interference()


class TimeBudget:
    """The time limit of the measurement, from `begin` on.

    It limits additional iterations, repetitions of affected iterations, and the confirmation run.
    It does not limit what the spec declares: without it, the run could not be judged.

    Attributes:
        left_out: a sentence for each part that was left out.
    """

    def __init__(self, limit_ns: int, note: Callable[[str], None]) -> None:
        """Create a budget, which has not begun yet.

        Args:
            limit_ns: the budget; 0 for none.
            note: receives a note about each part that is left out.
        """
        self._limit_ns = limit_ns
        self._note = note
        self._began_s: float | None = None
        self.left_out: list[str] = []

    def begin(self) -> None:
        """Start the clock."""
        self._began_s = time.monotonic()

    def spent_s(self) -> float:
        """Return the seconds since `begin`."""
        return 0.0 if self._began_s is None else time.monotonic() - self._began_s

    def allows(self, what: str, seconds: float) -> bool:
        """Return True if a part is expected to fit; if not, note it.

        Args:
            what: the note, such as ``no confirmation run``.
            seconds: the expected duration.
        """
        if not self._limit_ns or self.spent_s() + seconds <= self._limit_ns / 1e9:
            return True
        note = f"{what}: it would exceed the time budget of {Duration(self._limit_ns)}"
        self.leave_out(note)
        return False

    def leave_out(self, text: str) -> None:
        """Note that a part is left out; `text` is a sentence without its capital and full stop."""
        self._note(text)
        self.left_out.append(f"{text[:1].upper()}{text[1:]}.")


@dataclass(frozen=True)
class RunContext:
    """What every state of a run uses.

    Attributes:
        states: which one the run is in; receives notes.
        supervisor: all processes.
        folder: receives samples, logs and the record.
        base_dir: the folder of the spec, to which its paths are relative.
        scratch: a folder that is removed after the run.
        events: likewise, for what the processes of the graph record of themselves.
        progress: what the user is shown of a segment.
        resources: takes samples of processes and host at requested times.
        host: says what other programs did.
        loaded_files: what the processes of the graph have loaded so far.
        on_segment: is called after each segment.
        budget: the budget of the measurement.
    """

    states: RunStates
    supervisor: ProcessSupervisor
    folder: RunFolder
    base_dir: Path
    scratch: Path
    events: Path
    progress: Progress
    resources: ResourceSampler
    host: HostWatch
    loaded_files: LoadedFiles
    on_segment: Callable[[], None]
    budget: TimeBudget

    @property
    def buffer_dir(self) -> Path:
        """The folder of the messages to play."""
        return self.scratch / "buffers"

    def note(self, text: str) -> None:
        """Show the user a message, and keep it for the record."""
        self.states.note(text)
