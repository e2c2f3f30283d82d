"""The metrics of a run as frozen values that serialise to JSON.

Times are seconds, rates hertz, sizes bytes and shares fractions of one; of processor time, one
core is 1. None is no value: nothing arrived, or nothing was sampled.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from r2bspec.measure.distribution_parts import Distribution
from r2bspec.measure.interference import Surroundings
from r2bspec.record.run_record import Probe, SearchRecord


class HopMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """A hop of the path to a monitor: from one topic to the next, or from the player to the first.

    Of the messages received at `source`, `matched` were received at `target`, too, with the same
    stamp, and `missed` were not. `latency` is from reception at `source` to reception at `target`;
    from the player, it is from publication.
    """

    source: str
    target: str
    matched: int
    missed: int
    latency: Distribution


class MonitorMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """What one monitor received. In a live run, None where it depends on what was sent.

    `sent` counts steps. Each has one expected output, unless the monitor's ratio is another:
    ``expected = answered + missed``, and ``drop_rate = missed / expected``. Messages are counted
    by ``received = answered + duplicates + unmatched``.

    Attributes:
        reordered: outputs that arrived after that of a later step.
        late: outputs that arrived after the last step's period had ended.
        early: outputs that arrived before their step was published: matching by order has
            gone wrong.
        overdue: of the unmatched, outputs of steps of an earlier segment, which had ended.
        surplus: matched by order, outputs beyond the expected ones; of the unmatched.
        untimed: messages of which the middleware gave no time of reception: that of taking is used.
        unknown_latency: why there is no latency though there are answers; empty if there is one.
        hops: the path of the messages, where it is tapped.
    """

    sent: int | None
    answered: int | None
    missed: int | None
    drop_rate: float | None
    received: int
    duplicates: int | None
    reordered: int | None
    unmatched: int | None
    throughput_hz: float
    latency: Distribution
    latency_from_due: Distribution
    interval: Distribution
    jitter: Distribution
    late: int | None = 0
    early: int | None = 0
    overdue: int | None = 0
    surplus: int | None = 0
    untimed: int = 0
    unknown_latency: str = ""
    hops: tuple[HopMetrics, ...] = ()

    @property
    def expected(self) -> int | None:
        """The number of expected outputs."""
        if self.answered is None or self.missed is None:
            return None
        return self.answered + self.missed


class PlaybackMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """What was played: the published rate, and how late publications began.

    In a live run, in which nothing is played, both are None.
    """

    sent: int | None
    rate_hz: float | None
    lateness: Distribution


class UseMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """What a process and its descendants used; for the machine, all processes.

    `faults_per_message` is the number of page faults without reading from disk for each step that
    was played; None if it was not counted, or nothing was played.
    """

    cpu_mean: float | None
    cpu_max: float | None
    memory_max_bytes: int | None
    faults_per_message: float | None = None


class SegmentMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """One iteration, or several pooled (then `segment` is empty and `index` is None).

    `surroundings` is the host interference, where it was sampled; None if pooled. `start` is the
    start of the processes that it was played in, from 1; 0 if pooled, and in results of versions
    that did not state it.
    """

    segment: str
    index: int | None
    playback: PlaybackMetrics
    monitors: dict[str, MonitorMetrics]
    processes: dict[str, UseMetrics]
    machine: UseMetrics | None
    surroundings: Surroundings | None = None
    start: int = 0


class Spread(msgspec.Struct, frozen=True, kw_only=True):
    """The smallest and the largest value of a metric over the iterations."""

    low: float
    high: float


Pace = Literal["rate", "recording", "source"]
"""What sets the rate of messages: the offered rate, the recording, or, in a live run, the graph's
own source."""


def pace_of(mode: str) -> Pace:
    """What sets the rate of messages in a playback mode."""
    paces: dict[str, Pace] = {"timeline": "recording", "live": "source"}
    return paces.get(mode, "rate")


class RateMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """Everything measured at one offered rate; at 0, if `pace` is not a rate.

    `pooled` adds counts and pools single messages over all iterations; its rates and processor
    shares are the mean of the iterations' values. `spread` has, for each monitor, the range of
    metrics over the iterations, by the metric's name. `reruns` replace iterations affected by host
    interference; they are included in none of these.
    """

    offered_hz: float
    iterations: tuple[SegmentMetrics, ...]
    pooled: SegmentMetrics
    pace: Pace = "rate"
    spread: dict[str, dict[str, Spread]]
    reruns: tuple[SegmentMetrics, ...] = ()


class RunMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """Everything measured in a run, by offered rate in ascending order.

    `incomplete` are the iterations that were cut short; they are not included in any value.
    """

    rates: tuple[RateMetrics, ...]
    search: SearchRecord | None
    sustained: tuple[Probe, ...]
    incomplete: tuple[str, ...]
