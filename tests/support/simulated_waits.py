"""A server with a queue, played alone and on a machine that takes its processor away at times."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from r2bspec.judge.measure.host_usage import HostInterference
from r2bspec.judge.measure.matching import match_monitor
from r2bspec.judge.measure.sample_table import MonitorSamples, monitor_samples
from run_simulation import MONITOR_PLAN, segment_of
from simulated_queues import BEGIN_NS, Times, rows

Stalls = list[tuple[float, float]]
"""When no progress is made: beginning and length, in seconds, in order, without overlaps."""


@dataclass(frozen=True)
class Disturbed:
    """The same messages on a machine with other load, and alone.

    Attributes:
        seen: what a monitor recorded with the other load.
        measured: the latency of each message with the other load, in seconds; NaN if it was lost.
        latency: ascending, in seconds, alone; infinite for lost messages.
        interference: what was sampled meanwhile.
    """

    seen: MonitorSamples
    measured: Times
    latency: Times
    interference: HostInterference


def disturbed(
    load: float, *, depth: int, stalls: Stalls, spread: float = 0.0, seconds: float = 10.0
) -> Disturbed:
    """Offer 30 Hz to a server that could do 30 Hz / load, and whose queue keeps `depth` messages.

    Args:
        load: of the server when it is alone; over 1 it loses messages.
        depth: of its queue; the oldest message makes room for a new one.
        stalls: when others have its processor. While it has nothing to do it waits for none.
        spread: the standard deviation of the logarithms of its service times.
        seconds: for how long it is offered messages.
    """
    arrive = np.arange(round(seconds * 30.0)) / 30.0
    random = np.random.default_rng(1)
    service = load / 30.0 * np.exp(random.normal(0, spread, arrive.size))
    left, waited = _serve(arrive, service, depth, stalls)
    alone, _ = _serve(arrive, service, depth, [])
    return Disturbed(
        seen=_samples(arrive, left),
        measured=np.where(np.isfinite(left), left - arrive, np.nan),
        latency=np.sort(np.where(np.isfinite(alone), alone - arrive, np.inf)),
        interference=HostInterference(
            seconds=seconds, cores=2, foreign_cores=1.0, pressure=1.0, own_waited=waited / seconds
        ),
    )


def _serve(arrive: Times, service: Times, depth: int, stalls: Stalls) -> tuple[Times, float]:
    """When each message leaves, infinite for those that are lost; and how long it had to wait."""
    left = np.full(arrive.size, np.inf)
    queue: deque[int] = deque()
    free_s = waited_s = 0.0
    for number, now_s in enumerate([*arrive, np.inf]):
        while queue and max(free_s, arrive[queue[0]]) < now_s:
            first = queue.popleft()
            begin_s = max(free_s, arrive[first])
            free_s, stalled_s = _work(begin_s, service[first], stalls)
            left[first] = free_s
            waited_s += stalled_s
        queue.append(number)
        if len(queue) > depth and free_s > now_s:
            queue.popleft()
    return left, waited_s


def _work(begin_s: float, work_s: float, stalls: Stalls) -> tuple[float, float]:
    """When work ends that is interrupted by stalls, and for how long it was."""
    now_s, stalled_s = begin_s, 0.0
    for stall_s, length_s in stalls:
        end_s = stall_s + length_s
        if end_s <= now_s:
            continue
        if now_s + work_s <= stall_s:
            break
        work_s -= max(0.0, stall_s - now_s)
        stalled_s += end_s - max(now_s, stall_s)
        now_s = end_s
    return now_s + work_s, stalled_s


def _samples(arrive: Times, left: Times) -> MonitorSamples:
    came = np.flatnonzero(np.isfinite(left))
    played, seen = rows(arrive, arrive, came, left[came])
    segment = segment_of(30.0, arrive.size, BEGIN_NS)
    return monitor_samples(segment, match_monitor(played, seen, MONITOR_PLAN))
