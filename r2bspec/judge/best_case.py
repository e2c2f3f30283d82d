"""The best case of an affected iteration: only what no interference can explain remains.

The effect of host interference on single messages is unknown. Its effect is at most this:

    - It spoiled at most half of the messages, however they ended. The other half, the faster
      one, represents all: the message of rank i is given the latency of rank i - n/2.
    - It kept everything waiting for a share w of the time, so that without it latencies were
      shorter by up to that share, and the graph processed so much more:

          latency     x (1 - w)
          throughput  + w x the rate played, and not above that

      w is the pressure: no process of the run can have waited for a processor for longer.
      Where the kernel does not report the pressure, at least one core must have been taken, which
      lasts no longer than the processor time of others. Time for which a core was stolen, or
      throttled, is added. If the harness alone took c times as long, w is at least 1 - 1/c.
    - w is at most 3/4. A machine on which everything takes over four times as long does not keep
      the playback's schedule either, and makes the run INVALID.

Where the kernel counts how long the run's own processes waited for a processor, what that explains
is known better: `r2bspec.judge.waiting_bound` replaces these assumptions.

Further lost or late messages are caused by the graph itself. Processor time and memory of the
run's processes are unchanged: waiting uses neither. Of the machine's, the part of others is
left out.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.waiting_bound import MAX_SHARE, shortest_latencies, taken_share
from r2bspec.measure.host_usage import HostInterference, ResourceUse
from r2bspec.measure.matching import match_monitor
from r2bspec.measure.samples import (
    MonitorSamples,
    PlaybackSamples,
    SegmentSamples,
    monitor_samples,
)
from r2bspec.plan.plan import MonitorPlan
from r2bspec.record.run_record import Segment
from r2bspec.record.sample_arrays import MONITOR_DTYPE, PLAYBACK_DTYPE

_STAMP_MONITOR = MonitorPlan(name="", topic="", type="", match="stamp", qos=None)
"""Every step with an expected output is given a stamp of its own."""


def best_case_iteration(one: SegmentSamples, taken: float | None = None) -> SegmentSamples:
    """An iteration without any effect that host interference can have had on it.

    Args:
        one: the iteration.
        taken: the share w of the time whose effect is removed; what others can have taken from
            the run at most if None. With 0, nothing is.
    """
    if taken == 0:
        return one
    return replace(
        one,
        monitors={
            name: _best_case_samples(one.segment, one.playback, seen, one.interference, taken)
            for name, seen in one.monitors.items()
        },
        machine=_use_by_run(one),
    )


def waiting_share(known: HostInterference | None) -> float:
    """The largest share of the time for which the run can have been kept waiting; w above."""
    if known is None:
        return 0.0
    stolen = (known.steal or 0.0) * (known.cores or 1)
    throttled = (known.throttled_s or 0.0) / known.seconds if known.seconds else 0.0
    taken = known.foreign_cores or 0.0
    waited = known.pressure if known.pressure is not None else taken
    slower = 1 - 1 / known.calibration if known.calibration else 0.0
    return min(MAX_SHARE, max(waited + stolen + throttled, slower))


def _best_case_samples(
    segment: Segment,
    playback: PlaybackSamples,
    seen: MonitorSamples,
    known: HostInterference | None,
    taken: float | None,
) -> MonitorSamples:
    most_hz = playback.rate_hz * seen.per_step
    counted = taken_share(known)
    if counted is None or known is None:
        waited = waiting_share(known) if taken is None else taken
        latency = best_case_latencies(seen, waited)
    else:
        waited = counted if taken is None else taken
        latency = _measured_latencies(seen)
        order = np.argsort(latency, kind="stable")
        latency[order] = shortest_latencies(seen, waited, known.seconds, most_hz)
    played = np.zeros(latency.size, PLAYBACK_DTYPE)
    played["stamp_ns"] = np.arange(1, latency.size + 1)
    played["due_ns"], played["published_ns"] = seen.steps.due_ns, seen.steps.published_ns
    came = np.flatnonzero(np.isfinite(latency))
    rows = np.zeros(came.size, MONITOR_DTYPE)
    rows["stamp_ns"] = played["stamp_ns"][came]
    rows["received_ns"] = played["published_ns"][came] + np.round(latency[came]).astype(np.int64)
    ordered = rows[np.argsort(rows["received_ns"], kind="stable")]
    found = monitor_samples(segment, match_monitor(played, ordered, _STAMP_MONITOR))
    more = seen.duplicates + seen.unmatched
    return replace(
        found,
        # Interference creates no messages.
        received=found.received + more,
        duplicates=seen.duplicates,
        unmatched=seen.unmatched,
        throughput_hz=max(seen.throughput_hz, min(most_hz, seen.throughput_hz + waited * most_hz)),
        sent=seen.sent,
        early=seen.early,
        overdue=seen.overdue,
        per_step=seen.per_step,
        hops=seen.hops,
    )


def best_case_latencies(seen: MonitorSamples, waited: float) -> NDArray[np.float64]:
    """The best case of each step's latency, in ns; infinite where it stays lost.

    Args:
        seen: what a monitor received.
        waited: the share w of the time.
    """
    latency = _measured_latencies(seen)
    order = np.argsort(latency, kind="stable")
    better = -(-latency.size // 2)
    latency[order[better:]] = latency[order[: latency.size - better]]
    return np.asarray(latency * (1 - waited))


def _measured_latencies(seen: MonitorSamples) -> NDArray[np.float64]:
    """The latency of each step, in ns; infinite where it was lost."""
    steps = seen.steps
    return np.where(
        steps.answered, (steps.received_ns - steps.published_ns).astype(np.float64), math.inf
    )


def _use_by_run(one: SegmentSamples) -> ResourceUse | None:
    """What the run itself used of the machine."""
    machine = one.machine
    if machine is None:
        return None
    means = [used.cpu_mean for used in one.processes.values() if used.cpu_mean is not None]
    busiest = [used.cpu_max for used in one.processes.values() if used.cpu_max is not None]
    return replace(
        machine,
        cpu_mean=_at_most_sum(machine.cpu_mean, means),
        cpu_max=_at_most_sum(machine.cpu_max, busiest),
    )


def _at_most_sum(of_all: float | None, own: list[float]) -> float | None:
    return of_all if of_all is None or not own else min(of_all, math.fsum(own))
