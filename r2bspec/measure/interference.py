"""Host interference: what else happened on the machine during an interval."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from r2bspec.measure.resource_usage import (
    CONTROLLER_INDEX,
    ORPHANS_INDEX,
    ResourceUse,
    resource_use,
)
from r2bspec.record.run_record import FloorRecord
from r2bspec.record.sample_arrays import Rows

_MIN_LATENCY_DIFFERENCE_NS = 100_000


class Surroundings(msgspec.Struct, frozen=True, kw_only=True):
    """Host interference during one iteration; None is unknown.

    Attributes:
        seconds: how long the iteration lasted.
        cores: processors that the run may use.
        steal: the share of their time that other virtual machines got.
        foreign_cores: processor time per time that processes outside the run used on them.
        pressure: share of the time in which some task waited for a processor (PSI, ``some``).
        throttled_s: time for which a processor or the control group was throttled.
        calibration: latency of the harness alone, relative to its usual latency here.
        own_cores: processor time per time that the run used itself.
        own_waited: run-queue wait of all threads of the run per time; over 1 if several wait.
    """

    seconds: float = 0.0
    cores: int | None = None
    steal: float | None = None
    foreign_cores: float | None = None
    pressure: float | None = None
    throttled_s: float | None = None
    calibration: float | None = None
    own_cores: float | None = None
    own_waited: float | None = None


def host_interference(
    rows: Rows,
    resources: Rows,
    processes: frozenset[int],
    cores: int | None,
    began_ns: int,
    ended_ns: int,
) -> Surroundings | None:
    """The interference between two times, interpolated linearly between samples.

    Args:
        rows: of type `INTERFERENCE_DTYPE`, in order of time.
        resources: of type `RESOURCE_DTYPE`.
        processes: the indices of all processes of the run.
        cores: how many processors the run may use, where that is known.
        began_ns: the beginning of the window.
        ended_ns: its end.

    Returns:
        None if the samples do not cover the window.
    """
    seconds = (ended_ns - began_ns) / 1e9
    if seconds <= 0 or not _covers(rows, began_ns, ended_ns):
        return None
    stolen_s = _growth(rows, "stolen_s", began_ns, ended_ns)
    waited_s = _growth(rows, "waited_s", began_ns, ended_ns)
    busy_s = _growth(rows, "busy_s", began_ns, ended_ns)
    # Without orphans there are no rows of them.
    own = resource_use(resources, processes | {ORPHANS_INDEX}, began_ns, ended_ns)
    return Surroundings(
        seconds=seconds,
        cores=cores,
        steal=None if stolen_s is None or not cores else min(1.0, stolen_s / (seconds * cores)),
        foreign_cores=_foreign_cores(busy_s, own, resources, began_ns, ended_ns),
        pressure=None if waited_s is None else min(1.0, waited_s / seconds),
        throttled_s=_growth(rows, "throttled_s", began_ns, ended_ns),
        own_cores=own.cpu_mean if own is not None else None,
        own_waited=own.waited if own is not None else None,
    )


def _covers(rows: Rows, began_ns: int, ended_ns: int) -> bool:
    """Whether samples cover at least half of a window."""
    if rows.size < 2:
        return False
    inside = min(ended_ns, int(rows["time_ns"][-1])) - max(began_ns, int(rows["time_ns"][0]))
    return 2 * inside >= ended_ns - began_ns


def _growth(rows: Rows, field: str, began_ns: int, ended_ns: int) -> float | None:
    """By how much a sum grew; None if the system does not report it."""
    # Relative to the start of the window, because float64 cannot represent nanoseconds since boot.
    times = (rows["time_ns"] - began_ns) / 1e9
    first, last = np.interp([0.0, (ended_ns - began_ns) / 1e9], times, rows[field])
    grown = float(last - first)
    return max(0.0, grown) if math.isfinite(grown) else None


def _foreign_cores(
    busy_s: float | None, own: ResourceUse | None, resources: Rows, began_ns: int, ended_ns: int
) -> float | None:
    if busy_s is None or own is None or own.cpu_mean is None:
        return None
    controller = resource_use(resources, frozenset({CONTROLLER_INDEX}), began_ns, ended_ns)
    known = own.cpu_mean + ((controller.cpu_mean or 0.0) if controller is not None else 0.0)
    return max(0.0, busy_s / ((ended_ns - began_ns) / 1e9) - known)


def harness_slowdown(usual: tuple[FloorRecord, ...], now: tuple[FloorRecord, ...]) -> float | None:
    """The latency of the harness alone over its usual one: the largest ratio of the inputs.

    Medians of the same input are compared. A difference below `_MIN_LATENCY_DIFFERENCE_NS` is
    caused by the timer and the scheduler, whatever the ratio.

    Returns:
        None if the harness overhead of no input is in both.
    """
    before = {(each.topic, each.rate_hz): each.latency_p50_ns for each in usual}
    ratios = [
        each.latency_p50_ns / known
        if each.latency_p50_ns - known > _MIN_LATENCY_DIFFERENCE_NS
        else 1.0
        for each in now
        if each.latency_p50_ns and (known := before.get((each.topic, each.rate_hz)))
    ]
    return max(ratios, default=None)
