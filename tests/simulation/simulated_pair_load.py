"""Comparisons in interleaved pairs on machines that others use, too.

Each run of a pair is a whole one: 60 messages, of which each takes about 20 ms. A start is faster
or slower by a normal deviation, and while others take a share w of the time, everything takes
1 / (1 - w) times as long. The record of each run says how long its processes waited, and a head
that computes longer waits longer under the same load. Worlds say what share is taken in which run.
The verdicts are those of `judge_comparison`, with fresh pairs in the same world to confirm a FAIL.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import msgspec
import numpy as np
from numpy.typing import NDArray
from simulated_gates import Errors, heads

from r2bspec.judge.confirmation import confirm_run
from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.measure.host_usage import HostInterference
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.pair_comparison import (
    InterleavedRuns,
    PairSet,
    confirmation_terms,
    judge_pair_set,
)
from r2bspec.judge.verdict import InterferencePolicy, Verdict
from r2bspec.language.spec import Objective
from r2bspec.plan.interim_looks import InterimLooks
from r2bspec.record.comparison_folder import Side
from run_simulation import objective
from simulated_runs import RATE_HZ, run_of

Shares = NDArray[np.float64]
LoadWorld = Callable[[np.random.Generator, NDArray[np.bool_]], Shares]
"""The share of the time that others take from each of successive runs, some of them the head's."""

Sides = Mapping[Side, list[RunSamples]]

MESSAGES = 60
_OUTCOMES = {"pass": 1, "fail": -1}
_LOADED, _CALM = 0.4, 0.02
LATENCY_S = 0.02
_CORES = 2
_OWN_CORES = 0.4
_LEAST_FOREIGN_CORES = 0.5
"""Above this, an iteration counts as affected."""


def _idle(_: np.random.Generator, is_head: NDArray[np.bool_]) -> Shares:
    return np.zeros(is_head.size)


def _between(low: float, high: float) -> LoadWorld:
    return lambda random, is_head: random.uniform(low, high, is_head.size)


def _by_chance(random: np.random.Generator, is_head: NDArray[np.bool_]) -> Shares:
    return np.where(random.random(is_head.size) < 0.3, _LOADED, _CALM)


def _rising(random: np.random.Generator, is_head: NDArray[np.bool_]) -> Shares:
    return np.linspace(0, 0.5, is_head.size) + random.uniform(0, 0.02, is_head.size)


def _every(period: int) -> LoadWorld:
    def world(random: np.random.Generator, is_head: NDArray[np.bool_]) -> Shares:
        first = int(random.integers(period))
        return np.where(np.arange(is_head.size) % period == first, _LOADED, _CALM)

    return world


def _only(*, head: bool) -> LoadWorld:
    return lambda _, is_head: np.where(is_head == head, _LOADED, _CALM)


LOAD_WORLDS: dict[str, LoadWorld] = {
    "idle machine": _idle,
    "a third is taken from both sides": _between(0.32, 0.34),
    "from 10 to 50 % is taken": _between(0.1, 0.5),
    "3 runs in 10 are loaded": _by_chance,
    "load rises from 0 to a half": _rising,
    "every 2nd run is loaded": _every(2),
    "every 3rd run is loaded": _every(3),
    "every 4th run is loaded": _every(4),
    "all runs of the head, by bad luck": _only(head=True),
    "all runs of the base, by bad luck": _only(head=False),
}


@dataclass(frozen=True)
class PairGate:
    """A comparison to be made many times.

    Attributes:
        world: what others take.
        slower: how long the head takes, relative to the base.
        limit: of ``latency.p50 <= limit of baseline``, in %.
        pairs: how many.
        starts: by how much two starts of one graph differ: a standard deviation.
        interference: what it does to a verdict.
        fixed_order: whether runs are played in the order A B B A instead of by a coin.
    """

    world: LoadWorld
    slower: float = 1.0
    limit: float = 105.0
    pairs: int = 10
    starts: float = 0.027
    interference: InterferencePolicy = "note"
    fixed_order: bool = False

    def outcomes(self, *, runs: int, seed: int = 1) -> Errors:
        """Make it so many times."""
        random = np.random.default_rng(seed)
        counted = Errors(runs)
        objectives = {"slo": objective(f"latency.p50 <= {self.limit:g} % of baseline")}
        policy = DecisionPolicy(interference=self.interference)
        new_objectives, new_policy = confirmation_terms(objectives, policy)
        for _ in range(runs):
            first = self._session(random, objectives, policy)
            confirm = partial(self._confirm, first, random, new_objectives, new_policy)
            counted.add(_OUTCOMES.get(first.outcome, 0), confirm)
        return counted

    def _confirm(
        self,
        first: Verdict,
        random: np.random.Generator,
        objectives: Mapping[str, Objective],
        policy: DecisionPolicy,
    ) -> int:
        second = self._session(random, objectives, policy)
        return _OUTCOMES.get(confirm_run(first, second).outcome, 0)

    def _session(
        self,
        random: np.random.Generator,
        objectives: Mapping[str, Objective],
        policy: DecisionPolicy,
    ) -> Verdict:
        """Pairs up to the look that decides."""
        sides = self._play(random, self.pairs)
        looks = InterimLooks.after_each_pair(self.pairs)
        for end in looks.iterations:
            verdict = judge_pair_set(objectives, _pair_set(sides, end, looks), policy)
            early = any(requirement.early for requirement in verdict.requirements)
            if verdict.outcome in _OUTCOMES and not early:
                break
        return verdict

    def _play(self, random: np.random.Generator, pairs: int) -> Sides:
        is_head = heads(pairs, int(random.integers(2**32)))
        if self.fixed_order:
            is_head = np.resize([False, True, True, False], 2 * pairs)
        taken = self.world(random, is_head)
        level = np.exp(random.normal(0, self.starts / math.sqrt(2), 2 * pairs))
        slower = np.where(is_head, self.slower, 1.0)
        runs = [
            _run(random, *each)
            for each in zip(level.tolist(), slower.tolist(), taken.tolist(), strict=True)
        ]
        return {
            "base": [run for run, head in zip(runs, is_head, strict=True) if not head],
            "head": [run for run, head in zip(runs, is_head, strict=True) if head],
        }


def _pair_set(sides: Sides, number: int, looks: InterimLooks) -> PairSet:
    """The first pairs."""
    base, head = sides["base"][:number], sides["head"][:number]
    calm = [pair for pair in zip(base, head, strict=True) if not any(map(_is_affected, pair))]
    unaffected = None
    if len(calm) < number:
        unaffected = _interleaved([each for each, _ in calm], [each for _, each in calm])
    return PairSet(
        played=_interleaved(base, head),
        tried=number,
        looks=looks,
        unaffected=unaffected,
        disturbance_text="Host interference in some pairs",
    )


def _run(random: np.random.Generator, level: float, slower: float, taken: float) -> RunSamples:
    """One run: 2 s at 30 Hz."""
    noise = np.exp(random.normal(0, 0.05, (1, MESSAGES)))
    around = HostInterference(
        seconds=MESSAGES / RATE_HZ,
        cores=_CORES,
        foreign_cores=_CORES * taken,
        pressure=min(1.0, 2 * taken),
        own_cores=_OWN_CORES * slower,
        own_waited=taken * slower,
    )
    latency = LATENCY_S * level * slower / (1 - taken) * noise
    return run_of(latency, interference=[around])


def _is_affected(run: RunSamples) -> bool:
    (one,) = run.iterations[RATE_HZ]
    return one.interference is not None and (
        (one.interference.foreign_cores or 0.0) > _LEAST_FOREIGN_CORES
    )


def _interleaved(base: list[RunSamples], head: list[RunSamples]) -> InterleavedRuns:
    """Pairs, and the head's runs as one."""
    merged = tuple(
        replace(
            one, segment=msgspec.structs.replace(one.segment, id=f"pair-{number}", index=number)
        )
        for number, run in enumerate(head, start=1)
        for one in run.iterations[RATE_HZ]
    )
    nothing = run_of(np.empty((0, MESSAGES)))
    return InterleavedRuns(
        base, head, replace(nothing, iterations={RATE_HZ: merged} if merged else {})
    )
