"""Runs on a machine that takes the processor away, and whose kernel tells for how long.

The graph is a server with a queue of five. Its requirements are what it just meets alone, or what
it is far from: a third of the losses, and of the latency. Programs of others have the processor for
a share of the time, in stalls of a random length; it waits for it only while it has work.
"""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np

from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.pipeline import judge
from run_simulation import objective, with_interference
from simulated_runs import RATE_HZ, run_of
from simulated_waits import Stalls, disturbed

DEPTH = 5
ITERATIONS = 5
SECONDS = 10.0
LENGTHS_S = (0.003, 0.03, 0.3)


@dataclass(frozen=True)
class Fails:
    """The share of runs that fail: as they were measured, with the pressure, with the waits."""

    measured: float
    pressure: float
    waits: float


def fails(load: float, share: float, *, stricter: float, runs: int, seed: int = 1) -> Fails:
    """Judge runs of a server at a load, on a machine that others use for a share of the time.

    Args:
        load: of the server alone, at 30 Hz.
        share: of the time.
        stricter: the requirements are this share of what it does alone; 1 is just met.
        runs: their number.
        seed: of the stalls.
    """
    random = np.random.default_rng(seed)
    asked = _requirements(load, stricter)
    counts = np.zeros(3)
    for _ in range(runs):
        known = _run(random, load, share)
        for number, samples in enumerate(
            (with_interference(known, None), _only_pressure(known), known)
        ):
            verdict = judge({"slo": objective(*asked)}, samples, DecisionPolicy())
            counts[number] += verdict.outcome == "fail"
    return Fails(*(counts / runs).tolist())


def _requirements(load: float, stricter: float) -> tuple[str, ...]:
    """What the server just meets alone, made stricter."""
    alone = disturbed(load, depth=DEPTH, stalls=[], seconds=SECONDS)
    lost = float(np.isinf(alone.latency).mean())
    middle = float(np.median(alone.latency))
    found = [f"drop_rate <= {(lost * stricter + 0.001) * 100:.3f} %"]
    if np.isfinite(middle):
        found.append(f"latency.p50 < {middle * stricter * 1000 + 0.1:.3f} ms")
    return tuple(found)


def _run(random: np.random.Generator, load: float, share: float) -> RunSamples:
    played = [
        disturbed(load, depth=DEPTH, stalls=_stalls(random, share), seconds=SECONDS)
        for _ in range(ITERATIONS)
    ]
    return run_of(
        np.array([each.measured for each in played]),
        interference=[each.interference for each in played],
    )


def _stalls(random: np.random.Generator, share: float) -> Stalls:
    """Stalls of one kind, one after the other, that add up to about a share of the time."""
    length_s = float(random.choice(LENGTHS_S))
    found: Stalls = []
    now_s = 0.0
    while now_s < SECONDS:
        now_s += float(random.exponential(length_s * (1 - share) / share))
        stall_s = float(random.exponential(length_s))
        found.append((now_s, stall_s))
        now_s += stall_s
    return found


def _only_pressure(samples: RunSamples) -> RunSamples:
    """The run on a machine that does not tell how long its processes waited."""
    around = [one.interference for one in samples.iterations[RATE_HZ]]
    return with_interference(
        samples, *(msgspec.structs.replace(one, own_waited=None) for one in around if one)
    )
