"""Whole runs, from latencies to the verdict, without files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.measure.host_usage import HostInterference
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.pipeline import judge
from r2bspec.judge.verdict import Verdict
from run_simulation import Played, Simulation, objective, with_interference, with_starts

RATE_HZ = 30.0


def run_of(
    latency: Iterable[NDArray[np.float64]],
    starts: Sequence[int] = (),
    interference: Sequence[HostInterference] = (),
) -> RunSamples:
    """A run without files.

    Args:
        latency: in seconds, shape (iterations, messages); NaN is lost.
        starts: of the iterations; one start without them.
        interference: during each of them.
    """
    samples = Simulation([Played(RATE_HZ, row) for row in latency], cpu={}).samples()
    samples = with_starts(samples, starts) if starts else samples
    return with_interference(samples, *interference) if interference else samples


def judged(latency: NDArray[np.float64], *requirements: str, confidence: float = 0.95) -> Verdict:
    """Judge a run by requirements at 30 Hz."""
    return judge(
        {"slo": objective(*requirements)}, run_of(latency), DecisionPolicy(confidence=confidence)
    )
