"""What other programs did to a part of the run that has just ended: a probe, a start, the overhead.

Iterations are examined when the run is judged, from the same samples.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np

from r2bspec.execute.processes.resources import ResourceSampler
from r2bspec.judge.interference_bound import largest_taken_share
from r2bspec.judge.measure.host_usage import (
    HostInterference,
    ProcessSamples,
    host_interference,
    interference_reasons,
)
from r2bspec.record.sample_arrays import Rows

_SAMPLE_TIMEOUT_S = 1.0
_POLL_S = 0.005
_OWN_PRESSURE: Final = 1.0
"""A probe near the peak has tasks that wait for each other: pressure alone shows nothing."""


@dataclass(frozen=True)
class Interference:
    """What others did in a part of the run.

    Attributes:
        reasons: in words, as in reports; empty if no limit was exceeded.
        taken: the largest share of the time that they can have taken from the run.
    """

    reasons: tuple[str, ...] = ()
    taken: float = 0.0


@dataclass(frozen=True)
class HostWatch:
    """Answers for parts of the run that have ended.

    Attributes:
        resources: samples the run and the machine.
        process_count: how many processes the run has started so far.
        machine: as in `RunRecord.machine`.
    """

    resources: ResourceSampler
    process_count: Callable[[], int]
    machine: Mapping[str, Any]

    def between(self, began_ns: int, ended_ns: int) -> Interference:
        """The interference between two times (CLOCK_MONOTONIC), of which the second is past."""
        rows = self._rows_until(ended_ns)
        window = np.array([began_ns]), np.array([ended_ns])
        used = ProcessSamples(self.resources.rows()).used_in(*window)
        processes = range(self.process_count())
        (interference,) = host_interference(rows, used, processes, self.machine, *window)
        return interference_of(interference)

    def _rows_until(self, time_ns: int) -> Rows:
        """The samples, with one after this time if the sampler still runs."""
        deadline = time.monotonic() + _SAMPLE_TIMEOUT_S
        self.resources.sample_at(time.monotonic_ns())
        while True:
            rows = self.resources.interference()
            if (rows.size and rows["time_ns"][-1] >= time_ns) or time.monotonic() > deadline:
                return rows
            time.sleep(_POLL_S)


def interference_of(found: HostInterference | None) -> Interference:
    """What was sampled, in words and as a share."""
    reasons = interference_reasons(found, _OWN_PRESSURE)
    if found is None or not reasons:
        return Interference()
    if found.own_waited is None:
        # The pressure is the graph's own, too; what others used bounds what they took.
        used = found.foreign_cores or 0.0
        pressure = min(used, 1.0 if found.pressure is None else found.pressure)
        found = msgspec.structs.replace(found, pressure=pressure)
    return Interference(reasons, largest_taken_share(found))
