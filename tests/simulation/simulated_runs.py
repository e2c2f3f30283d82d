"""Whole runs, from latencies to the verdict, without files."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.measure.host_usage import HostInterference
from r2bspec.judge.measure.matching import match_monitor
from r2bspec.judge.measure.samples import (
    RunSamples,
    SegmentSamples,
    monitor_samples,
    playback_samples,
)
from r2bspec.judge.pipeline import judge
from r2bspec.judge.verdict import Verdict
from r2bspec.record.run_record import Segment
from run_simulation import (
    EMPTY_RECORD,
    EPOCH_NS,
    Played,
    monitor_plan,
    monitor_rows,
    objective,
    playback_rows,
)

RATE_HZ = 30.0


def run_of(
    latency: NDArray[np.float64],
    starts: Sequence[int] = (),
    interference: Sequence[HostInterference] = (),
) -> RunSamples:
    """A run without files.

    Args:
        latency: in seconds, shape (iterations, messages); NaN is lost.
        starts: of the iterations; one start without them.
        interference: during each of them.
    """
    segments = []
    start_ns = EPOCH_NS
    for index, row in enumerate(latency, start=1):
        played = Played(RATE_HZ, row)
        playback = playback_rows(played, start_ns)
        ended_ns = start_ns + round(row.size * 1e9 / RATE_HZ)
        segment = Segment(
            id=f"rate-30Hz-{index:03d}",
            kind="iteration",
            rate_hz=RATE_HZ,
            index=index,
            steps=row.size,
            began_ns=start_ns,
            ended_ns=ended_ns,
            complete=True,
            start=starts[index - 1] if starts else 1,
        )
        segments.append(
            SegmentSamples(
                segment=segment,
                playback=playback_samples(playback),
                monitors={
                    "out": monitor_samples(
                        segment,
                        match_monitor(
                            playback, monitor_rows(played, playback), monitor_plan("out")
                        ),
                    )
                },
                processes={},
                machine=None,
                interference=interference[index - 1] if interference else None,
            )
        )
        start_ns = ended_ns + 500_000_000
    return RunSamples(
        record=EMPTY_RECORD,
        monitors=("out",),
        iterations={RATE_HZ: tuple(segments)} if segments else {},
        sustained={},
        incomplete=(),
    )


def judged(latency: NDArray[np.float64], *requirements: str, confidence: float = 0.95) -> Verdict:
    """Judge a run by requirements at 30 Hz."""
    return judge(
        {"slo": objective(*requirements)}, run_of(latency), DecisionPolicy(confidence=confidence)
    )
