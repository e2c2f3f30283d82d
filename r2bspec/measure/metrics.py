"""The metrics of a run as frozen values that serialise to JSON.

Times are seconds, rates hertz, sizes bytes and shares fractions of one; of processor time, one
core is 1. None stands for 'no value': nothing arrived, or nothing was sampled.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from r2bspec.measure.distribution_parts import Distribution
from r2bspec.measure.interference import Surroundings
from r2bspec.record.run_record import Probe, SearchRecord


class HopMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """A hop of the way to a monitor: from one topic to the next, or from the player to the first.

    Of the messages that were seen at `source`, `matched` were seen at `target`, too, with the same
    stamp, and `missed` were not. `latency` is from reception there to reception here; from the
    player, it is from publication.
    """

    source: str
    target: str
    matched: int
    missed: int
    latency: Distribution


class MonitorMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """What one monitor saw. Of a live run, what needs to know what was sent is None.

    `sent` counts steps. They let expect as many answers, unless the monitor's ratio is another:
    ``expected = answered + missed``, and ``drop_rate = missed / expected``. Messages are counted
    by ``received = answered + duplicates + unmatched``.

    Attributes:
        reordered: answers that came after that of a later step.
        late: answers that came after the last step's period had ended.
        early: answers that came before their step was published: by order, the counting has
            gone wrong.
        overdue: of the unmatched, answers to steps of an earlier segment, given up by then.
        hops: the way of the messages, where it is tapped.
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
    hops: tuple[HopMetrics, ...] = ()

    @property
    def expected(self) -> int | None:
        """Answers that the steps let expect."""
        if self.answered is None or self.missed is None:
            return None
        return self.answered + self.missed


class PlaybackMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """What was played: the rate really published, and how late publications began.

    Of a live run, in which nothing is played, both are None.
    """

    sent: int | None
    rate_hz: float | None
    lateness: Distribution


class UseMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """What a process and its descendants used; or, for the machine, everything that ran."""

    cpu_mean: float | None
    cpu_max: float | None
    memory_max_bytes: int | None


class SegmentMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """One iteration, or several pooled (then `segment` is empty and `index` is None).

    `surroundings` is what else happened on the machine, where that was sampled; None if pooled.
    """

    segment: str
    index: int | None
    playback: PlaybackMetrics
    monitors: dict[str, MonitorMetrics]
    processes: dict[str, UseMetrics]
    machine: UseMetrics | None
    surroundings: Surroundings | None = None


class Spread(msgspec.Struct, frozen=True, kw_only=True):
    """The smallest and the largest value of a metric over the iterations."""

    low: float
    high: float


Pace = Literal["rate", "recording", "source"]
"""Who says how fast messages come: a rate that was asked for, the recording, or, in a live run, the
graph's own source."""


def pace_of(mode: str) -> Pace:
    """Who says how fast messages come in a playback mode."""
    paces: dict[str, Pace] = {"timeline": "recording", "live": "source"}
    return paces.get(mode, "rate")


class RateMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """Everything measured at one offered rate; at 0, if `pace` is not a rate.

    `pooled` adds counts and pools single messages over all iterations; its rates and processor
    shares are the mean of the iterations' values. `spread` holds, for each monitor, how far
    metrics differ between iterations, by the metric's name. `reruns` were played in the place of
    iterations that the machine disturbed; they are in none of these.
    """

    offered_hz: float
    iterations: tuple[SegmentMetrics, ...]
    pooled: SegmentMetrics
    pace: Pace = "rate"
    spread: dict[str, dict[str, Spread]]
    reruns: tuple[SegmentMetrics, ...] = ()


class RunMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """Everything measured in a run, by offered rate in ascending order.

    `incomplete` names the iterations that were cut short; they are in no number.
    """

    rates: tuple[RateMetrics, ...]
    search: SearchRecord | None
    sustained: tuple[Probe, ...]
    incomplete: tuple[str, ...]
