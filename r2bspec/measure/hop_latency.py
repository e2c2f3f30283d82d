"""The latency of a graph, split into that of its hops by the taps.

The same message is identified at every tap by its header stamp. With t_A(s) the time at which the
message of step s was received at A, the latency of the hop from A to B is

    t_B(s) - t_A(s)

for every step received at both. For the player, t(s) is when publishing of the step began. Means of
successive hops add up to the mean of the whole path, for the same steps; percentiles do not.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from r2bspec.measure.matching import NO_MATCH, Matching, match
from r2bspec.measure.times import Seconds, seconds
from r2bspec.plan.plan import MonitorPlan, Plan
from r2bspec.plan.taps import PLAYER, hops_to
from r2bspec.record.sample_arrays import Rows


@dataclass(frozen=True)
class HopSamples:
    """One hop: its latency in seconds, a value for each step received at both ends, in their order.

    `missed` steps were received at `source` and not at `target`.
    """

    source: str
    target: str
    times: Seconds
    missed: int


def hop_samples(
    plan: Plan,
    monitor: MonitorPlan,
    playback: Rows,
    taps: Mapping[str, Rows],
    seen: Rows,
    matched: Matching,
) -> tuple[HopSamples, ...]:
    """The hops of the path to a monitor, in one segment.

    A tap whose messages have no header is left out, and its two hops are merged.

    Args:
        plan: of the run.
        monitor: the monitor; without taps there are no hops.
        playback: rows of type `PLAYBACK_DTYPE`.
        taps: rows of type `MONITOR_DTYPE` of each tap, by topic.
        seen: rows of type `MONITOR_DTYPE` of the monitor itself.
        matched: how these match.
    """
    if not monitor.taps:
        return ()
    unstamped = [name for name, rows in taps.items() if rows.size and not rows["stamp_ns"].any()]
    times = {name: _received_by_stamp(playback, rows) for name, rows in taps.items()}
    times[PLAYER] = playback["published_ns"]
    times[monitor.topic] = _received_by_step(playback.size, seen, matched)
    waited = np.zeros(playback.size, dtype=np.bool_)
    waited[matched.trigger_steps] = True
    everything = np.ones(playback.size, dtype=np.bool_)
    return tuple(
        _hop(source, target, times, waited if target == monitor.topic else everything)
        for source, target in hops_to(plan, monitor, unstamped)
    )


def _received_by_stamp(playback: Rows, rows: Rows) -> NDArray[np.int64]:
    """When the message of each step was first received at a tap; shape (steps,)."""
    return _received_by_step(playback.size, rows, match(playback, rows, "stamp"))


def _received_by_step(steps: int, rows: Rows, matched: Matching) -> NDArray[np.int64]:
    received = np.full(steps, NO_MATCH, dtype=np.int64)
    answered = np.flatnonzero(matched.answered)[::-1]  # the first of several is written last
    received[matched.trigger_steps[answered]] = rows["received_ns"][matched.first_row[answered]]
    return received


def _hop(
    source: str, target: str, times: Mapping[str, NDArray[np.int64]], waited: NDArray[np.bool_]
) -> HopSamples:
    there, here = times[source], times[target]
    seen = (there != NO_MATCH) & waited
    both = seen & (here != NO_MATCH)
    return HopSamples(
        source=source,
        target=target,
        times=seconds(here[both] - there[both]),
        missed=int(np.count_nonzero(seen) - np.count_nonzero(both)),
    )


def pool_hops(iterations: Sequence[Iterable[HopSamples]]) -> tuple[HopSamples, ...]:
    """Each hop over several iterations: messages pooled, counts added."""
    found: dict[tuple[str, str], list[HopSamples]] = {}
    for hops in iterations:
        for hop in hops:
            found.setdefault((hop.source, hop.target), []).append(hop)
    return tuple(
        HopSamples(
            source=source,
            target=target,
            times=np.concatenate([hop.times for hop in hops]),
            missed=sum(hop.missed for hop in hops),
        )
        for (source, target), hops in found.items()
    )
