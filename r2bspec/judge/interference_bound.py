"""What host interference can explain at most: the best case of an affected iteration.

Scheduling delay
----------------

Other programs slow a run down while its threads could run but do not (`own_waited`), while the
processors that it runs on are shared with them, stolen, or throttled. So they took at most the
share

    w = waited + stolen + throttled + shared,    shared = 1/2 min(own cores, foreign cores)

of the time from it. The sum is over all threads, of the harness, too, though they may have waited
at once. A processor whose second hardware thread runs another program is at least half as fast, so
that `shared` counts where the machine says that two hardware threads share a core. Waiting of other
programs counts in the pressure of the machine, but explains nothing: a node that sleeps is not
slowed down by them.

From w follows, for n messages offered at a rate r, of which c come out per second:

    lost        at most w n + 2 v sqrt(w n) + 1 messages: those for whose service there was time
                otherwise. Where services differ by a share v of their mean, so does their number in
                a time: by v sqrt(w n), its standard deviation
    throughput  at most w r more
    latency     A second of waiting delays the messages that are in the graph then, and those that
                come before the graph is idle again. So messages were delayed by at most w T m in
                total, with T the length of the iteration, and m the largest number of messages in
                one busy period. This is distributed in the most favourable way: the latency of
                rank k is at least the u for which the k fastest exceed u by w T m in total. No
                message was delayed by more than w T.

Nor can a message be faster than its own work. Where each input has one output, let e be the time
from the moment when a message was in the graph and all before it had left until it left itself: its
own work, and what was taken meanwhile. The moments of different messages do not overlap, so that
what was taken from all of them is at most w T, however many share a busy period. After the waits,
and whatever is stolen or throttled, the rest of e was at least half as fast:

    latency     of rank k at least the u for which the k smallest e exceed u by w T in total, and
                half of that for which they exceed it by (w - shared) T

After a message that was lost it is unknown when the one before it left, and e counts as 0.

A graph that is overloaded anyway, because c + w r < r, is never idle, and one busy period would
explain everything. There the backlog grows at the rate r - c - w r instead of r - c, and is served
at the rate c + w r instead of c. Latencies are proportional to the backlog:

    latency     at least the latency x (r - c - w r) / (r - c) x c / (c + w r)

or the bound above, with m the largest number of messages in the graph at once, if that is less.
Both less 1 / r: when a message finds the graph ready depends on where in a period that is.

Where the kernel does not count it
----------------------------------

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
is known better, and replaces these assumptions.

What is observed from inside
----------------------------

    callback    and take: what was taken from all of them together is at most w T, distributed in
                the most favourable way
    wait        and transport: none was longer by more than w T
    load        and the share of messages that were overtaken: at most w more
    path        any share may be that of the waiting

Further lost or late messages are caused by the graph itself. Processor time and memory of the
run's processes are unchanged: waiting uses neither. Of the machine's, the part of others is
left out.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.host_usage import HostInterference, ResourceUse
from r2bspec.judge.measure.matching import NO_MATCH
from r2bspec.judge.measure.metric_catalogue import ANATOMY_SHARES
from r2bspec.judge.measure.samples import (
    MonitorSamples,
    SegmentSamples,
    late_outputs,
    output_period_ns,
    samples_of_steps,
)
from r2bspec.judge.measure.times import Seconds
from r2bspec.record.run_record import Segment

REMEDY: Final = "Run again on an otherwise idle machine."

MAX_SHARE = 0.75
"""A machine on which everything takes over four times as long keeps no schedule either."""

_SHARED_PROCESSOR_LOSS = 0.5

_DEVIATIONS = 2.0
"""How many more messages may have been lost than on average, in standard deviations."""

_NORMAL_DECILE = 1.2816
"""Standard deviations from the median of a normal distribution to its first decile."""


def taken_share(known: HostInterference | None) -> float | None:
    """The largest share of the time that others can have taken from the run: w above.

    Returns:
        None where the run-queue wait is unknown.
    """
    if known is None or known.own_waited is None:
        return None
    # While a thread of the run waits, some task does.
    waited = min(known.own_waited, math.inf if known.pressure is None else known.pressure)
    return min(MAX_SHARE, _with_known_losses(waited, known) + _shared_share(known))


def _shared_share(known: HostInterference | None) -> float:
    """The part of w that others took by running on the second hardware threads."""
    if known is None or (known.threads_per_core or 1) < 2:
        return 0.0
    return _SHARED_PROCESSOR_LOSS * min(known.own_cores or 0.0, known.foreign_cores or 0.0)


def _with_known_losses(waited: float, known: HostInterference) -> float:
    """A share of waiting with what was stolen and throttled; at least what calibration shows."""
    stolen = (known.steal or 0.0) * (known.cores or 1)
    throttled = (known.throttled_s or 0.0) / known.seconds if known.seconds else 0.0
    slower = 1 - 1 / known.calibration if known.calibration else 0.0
    return min(MAX_SHARE, max(waited + stolen + throttled, slower))


def shortest_latencies(
    seen: MonitorSamples, taken: float, seconds: float, offered_hz: float, shared: float = 0.0
) -> NDArray[np.float64]:
    """The shortest latencies that waiting leaves possible, in ns, ascending; infinite for lost.

    Args:
        seen: what a monitor received.
        taken: the share w of the time.
        seconds: the length of the iteration.
        offered_hz: the rate at which outputs were expected.
        shared: the part of w during which the run had a part of a processor.
    """
    steps = seen.steps
    published, received = steps.published_ns[steps.answered], steps.received_ns[steps.answered]
    latency = np.sort((received - published).astype(np.float64))
    lost = int(steps.answered.size) - int(latency.size)
    if not taken:
        return np.concatenate((latency, np.full(lost, np.inf)))
    lasting_ns = taken * seconds * 1e9
    answered_hz = latency.size / seconds if seconds else 0.0
    possible_hz = answered_hz + taken * offered_hz
    if answered_hz > 0 and possible_hz < offered_hz:
        growth = (offered_hz - possible_hz) / (offered_hz - answered_hz)
        at_once = _most_at_once(published, received)
        shorter = np.minimum(
            latency * growth * (answered_hz / possible_hz),
            _level(latency, lasting_ns * at_once),
        )
        latency = np.maximum(0.0, np.maximum(shorter, latency - lasting_ns) - 1e9 / offered_hz)
    else:
        longest = _longest_busy_period(published, received)
        own = _own_times(seen)
        latency = np.maximum.reduce(
            (
                _level(latency, lasting_ns * longest),
                latency - lasting_ns,
                _level(own, lasting_ns),
                _level(own, (taken - shared) * seconds * 1e9) * _SHARED_PROCESSOR_LOSS,
            )
        )
    mean = taken * steps.answered.size
    more = _DEVIATIONS * _relative_spread(_own_times(seen)) * math.sqrt(mean)
    explained = min(lost, math.ceil(mean + more) + 1)
    return np.concatenate((np.zeros(explained), latency, np.full(lost - explained, np.inf)))


def _own_times(seen: MonitorSamples) -> NDArray[np.float64]:
    """How long each answered message was the first in the graph, in ns, ascending: e above."""
    steps = seen.steps
    answered = steps.answered
    published, received = steps.published_ns[answered], steps.received_ns[answered]
    if seen.per_step != 1 or not received.size:
        return np.zeros(received.size)
    left = np.maximum.accumulate(received)
    before = np.concatenate((published[:1], left[:-1]))
    own = np.maximum(0, received - np.maximum(published, before)).astype(np.float64)
    own[np.diff(np.flatnonzero(answered), prepend=-1) > 1] = 0.0
    return np.sort(own)


def _relative_spread(own: NDArray[np.float64]) -> float:
    """The standard deviation of own times by their median, from the lower half: waits lengthen."""
    known = own[own > 0]
    if not known.size:
        return 0.0
    decile, median = np.percentile(known, (10, 50))
    return float((median - decile) / median) / _NORMAL_DECILE


def _level(ascending: NDArray[np.float64], budget: float) -> NDArray[np.float64]:
    """For each rank k, the u with sum over i <= k of max(0, x_i - u) = budget; at least 0.

    If j values are above u, those up to rank k, then u = (their sum - budget) / j. u grows with k,
    and so does the first rank above it.
    """
    sums = np.concatenate(([0.0], np.cumsum(ascending)))
    levels = np.zeros(ascending.size)
    first = 0
    for rank in range(1, ascending.size + 1):
        level = (sums[rank] - sums[first] - budget) / (rank - first)
        while first < rank - 1 and ascending[first] <= level:
            first += 1
            level = (sums[rank] - sums[first] - budget) / (rank - first)
        levels[rank - 1] = max(0.0, level)
    return levels


def _most_at_once(published: NDArray[np.int64], received: NDArray[np.int64]) -> int:
    """The largest number of messages that were in the graph at once."""
    if not published.size:
        return 0
    order = np.argsort(np.concatenate((published, received)), kind="stable")
    changes = np.concatenate((np.ones(published.size), -np.ones(received.size)))[order]
    return int(np.cumsum(changes).max())


def _longest_busy_period(published: NDArray[np.int64], received: NDArray[np.int64]) -> int:
    """The largest number of messages during which the graph was never empty."""
    if not published.size:
        return 0
    order = np.argsort(published, kind="stable")
    starts, ends = published[order], np.maximum.accumulate(received[order])
    # A message begins a busy period if all before it were answered when it was published.
    first = np.flatnonzero(np.concatenate(([True], starts[1:] > ends[:-1])))
    return int(np.diff(np.append(first, starts.size)).max())


def best_case_iteration(one: SegmentSamples, taken: float | None = None) -> SegmentSamples:
    """An iteration without any effect that host interference can have had on it.

    Args:
        one: the iteration.
        taken: the share w of the time whose effect is removed; what others can have taken from
            the run at most if None. With 0, nothing is.
    """
    if taken == 0:
        return one
    shared = 0.0
    if taken is None:
        taken = largest_taken_share(one.interference)
        shared = min(_shared_share(one.interference), taken)
    return replace(
        one,
        monitors={
            name: _best_case_samples(one, seen, taken, shared)
            for name, seen in one.monitors.items()
        },
        machine=_use_by_run(one),
        anatomy=_best_anatomy(one, taken),
    )


def _best_anatomy(one: SegmentSamples, taken: float) -> dict[str, Seconds]:
    """What was observed from inside, without any effect that others can have had on it."""
    lasting_s = taken * one.segment.length_s
    best = {}
    for name, values in one.anatomy.items():
        if name.endswith(ANATOMY_SHARES):
            best[name] = np.maximum(0.0, values - (1.0 if name.startswith("path.") else taken))
            continue
        shortest = values - lasting_s
        if name.endswith((".callback", ".take")):
            order = np.argsort(values, kind="stable")
            shortest[order] = np.maximum(shortest[order], _level(values[order], lasting_s))
        best[name] = np.maximum(0.0, shortest)
    return best


def _worst_anatomy(one: SegmentSamples, taken: float) -> dict[str, Seconds]:
    """What was observed from inside, with all that others can have spared it."""
    worst = {}
    for name, values in one.anatomy.items():
        if name.endswith(ANATOMY_SHARES):
            worst[name] = np.minimum(1.0, values + (1.0 if name.startswith("path.") else taken))
        else:
            worst[name] = _with_longest(values, taken)
    return worst


def _with_longest(values: Seconds, taken: float) -> Seconds:
    """The shortest values, which interference can have spared, are as long as the longest."""
    longest = np.sort(values)
    if values.size:
        longest[: math.ceil(taken * values.size) + 1] = longest[-1]
    return longest


def waiting_share(known: HostInterference | None) -> float:
    """The largest share of the time for which the run can have been kept waiting; w above."""
    if known is None:
        return 0.0
    waited = known.pressure if known.pressure is not None else known.foreign_cores or 0.0
    return _with_known_losses(waited, known)


def largest_taken_share(known: HostInterference | None) -> float:
    """The largest share of the time that others can have taken from the run: w, either way."""
    taken = taken_share(known)
    return waiting_share(known) if taken is None else taken


def _best_case_samples(
    one: SegmentSamples, seen: MonitorSamples, taken: float, shared: float
) -> MonitorSamples:
    most_hz, known = one.playback.rate_hz * seen.per_step, one.interference
    if seen.own_pace and not one.live:
        return _best_at_own_pace(one.segment, seen, taken)
    latency = _measured_latencies(seen)
    order = np.argsort(latency, kind="stable")
    if known is None or known.own_waited is None:
        # The faster half represents all.
        better = -(-latency.size // 2)
        latency[order[better:]] = latency[order[: latency.size - better]]
        latency *= 1 - taken
    else:
        latency[order] = shortest_latencies(seen, taken, known.seconds, most_hz, shared)
    gained_hz = min(most_hz, seen.throughput_hz + taken * most_hz)
    return _with_latencies(one.segment, seen, latency, max(seen.throughput_hz, gained_hz))


def _best_at_own_pace(segment: Segment, seen: MonitorSamples, taken: float) -> MonitorSamples:
    """No message was held up by more than all of the time that others took."""
    longest_s = taken * segment.length_s
    return replace(
        seen,
        times={name: np.maximum(0.0, times - longest_s) for name, times in seen.times.items()},
        throughput_hz=seen.throughput_hz / max(1 - taken, 0.01),
    )


def _worst_at_own_pace(seen: MonitorSamples, taken: float) -> MonitorSamples:
    times = {name: _with_longest(found, taken) for name, found in seen.times.items()}
    return replace(seen, times=times, throughput_hz=seen.throughput_hz * (1 - taken))


def worst_case_iteration(one: SegmentSamples, taken: float) -> SegmentSamples:
    """An iteration with all that interference can have spared it.

    What had less to do because of it, such as a filter that got fewer inputs, was faster for that
    reason. So the w n + 1 messages that others can have had a part in, the fastest ones, count as
    lost, and w of the rate as not delivered.

    Args:
        one: the iteration.
        taken: the share w of the time.
    """
    monitors = {}
    for name, seen in one.monitors.items():
        if seen.own_pace and not one.live:
            monitors[name] = _worst_at_own_pace(seen, taken)
            continue
        latency = _measured_latencies(seen)
        touched = math.ceil(taken * latency.size) + 1
        latency[np.argsort(latency, kind="stable")[:touched]] = math.inf
        least_hz = seen.throughput_hz - taken * one.playback.rate_hz * seen.per_step
        monitors[name] = _with_latencies(one.segment, seen, latency, max(0.0, least_hz))
    return replace(one, monitors=monitors, anatomy=_worst_anatomy(one, taken))


def _with_latencies(
    segment: Segment, seen: MonitorSamples, latency: NDArray[np.float64], throughput_hz: float
) -> MonitorSamples:
    """What a monitor would have received with other latencies, in ns; infinite for lost."""
    arrives = np.isfinite(latency)
    received_ns = np.full(latency.size, NO_MATCH, dtype=np.int64)
    received_ns[arrives] = seen.steps.published_ns[arrives] + np.round(latency[arrives]).astype(
        np.int64
    )
    steps = replace(seen.steps, received_ns=received_ns)
    period_ns = output_period_ns(segment, seen.sent, seen.per_step)
    ended_ns = segment.began_ns + round(latency.size * period_ns)
    found = samples_of_steps(steps, ended_ns, 0.0, 0.0)
    return replace(
        seen,
        steps=steps,
        times=found.times,
        # Interference creates no messages.
        received=found.received + seen.duplicates + seen.unmatched,
        throughput_hz=throughput_hz,
        reordered=steps.reordered,
        late=late_outputs(segment, steps),
        # Which step each output answers is known here.
        own_pace=False,
        by_order=False,
        surplus=0,
    )


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
