"""Runs on a machine that disturbs them: what was played, what was played again, and what is known.

The graph is one that just meets ``latency.p99 < 60 ms`` (1 % of its messages, in bursts of 5, take
longer), or misses it by a known factor. Its machine disturbs iterations at random:

    stalls      stretches of messages are late by 200 ms; a third of all, so that the pressure is a
                third as well
    contention  everything takes half as long again, and tasks wait for a third of the time
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.measure.host_usage import HostInterference
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.pipeline import judge
from run_simulation import objective, with_interference
from simulated_runs import RATE_HZ, run_of

Kind = Literal["stalls", "contention"]

LIMIT_S = 0.06
ASKED = "latency.p99 < 60 ms"
_CALM = HostInterference(seconds=10.0, cores=2, foreign_cores=0.0, pressure=0.02)
_BUSY = HostInterference(seconds=10.0, cores=2, foreign_cores=1.5, pressure=1 / 3)


@dataclass(frozen=True)
class Machine:
    """How often it disturbs an iteration, and how."""

    kind: Kind
    share: float


@dataclass(frozen=True)
class Counts:
    """Outcomes of many runs: as they were played, and with the disturbances known."""

    played: Counter[str]
    known: Counter[str]

    def fails(self) -> tuple[float, float]:
        """The share of runs that fail, either way."""
        return self.played["fail"] / self.played.total(), self.known["fail"] / self.known.total()


def outcomes(
    machine: Machine, *, runs: int, slower: float = 1.0, iterations: int = 10, seed: int = 1
) -> Counts:
    """Judge many runs of a graph that is `slower` times as slow as it may just be."""
    random = np.random.default_rng(seed)
    played: Counter[str] = Counter()
    known: Counter[str] = Counter()
    for _ in range(runs):
        samples = _run(random, machine, slower, iterations)
        for count, each in ((played, with_interference(samples, None)), (known, samples)):
            count[judge({"slo": objective(ASKED)}, each, DecisionPolicy()).outcome] += 1
    return Counts(played, known)


def _run(
    random: np.random.Generator, machine: Machine, slower: float, iterations: int
) -> RunSamples:
    """A run whose disturbed iterations were all played again, on the same machine."""
    latency = _latencies(random, 2 * iterations) * slower
    busy = random.random(2 * iterations) < machine.share
    for row in np.flatnonzero(busy):
        latency[row] = _disturbed(random, machine.kind, latency[row])
    samples = run_of(latency, interference=[_BUSY if hit else _CALM for hit in busy])
    played = samples.iterations[RATE_HZ]
    first, again = played[:iterations], played[iterations:]
    reruns = {
        one.segment.id: replace(
            other, segment=msgspec.structs.replace(other.segment, rerun_of=one.segment.id)
        )
        for one, other, hit in zip(first, again, busy.tolist()[:iterations], strict=True)
        if hit
    }
    return replace(samples, iterations={RATE_HZ: first}, reruns=reruns)


def _bursts(random: np.random.Generator, length: float, iterations: int) -> NDArray[np.bool_]:
    """1 % of the messages, in bursts of a mean length: a two-state Markov chain."""
    share, leave = 0.01, 1 / length
    enter = leave * share / (1 - share)
    found = np.empty((iterations, 300), dtype=np.bool_)
    state = random.random(iterations) < share
    for step in range(found.shape[1]):
        found[:, step] = state
        draw = random.random(iterations)
        state = np.where(state, draw >= leave, draw < enter)
    return found


def _latencies(random: np.random.Generator, iterations: int) -> NDArray[np.float64]:
    """Seconds, shape (iterations, 300): 1 % in bursts of 5 just over the limit, others at half."""
    late = _bursts(random, 5, iterations)
    usual = random.uniform(0.3, 0.5, late.shape) * LIMIT_S
    return np.asarray(np.where(late, LIMIT_S * random.uniform(1.0, 1.5, late.shape), usual))


def _disturbed(
    random: np.random.Generator, kind: Kind, latency: NDArray[np.float64]
) -> NDArray[np.float64]:
    if kind == "contention":
        return latency * 1.5
    # Ten stalls of ten messages; each empties its queue as it ends.
    starts = random.choice(latency.size // 10, 10, replace=False) * 10
    late = latency.copy()
    for start in starts:
        late[start : start + 10] += np.linspace(0.2, 0.02, 10)
    return late
