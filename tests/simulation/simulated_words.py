"""What a verdict says in worlds that no test can hold.

A wrong verdict must at least say what it could not know. The runs that the simulation judges
wrongly are judged once more from their messages, as a run is, and the words of the verdict are
read: in its limits, which every report shows, and in the notes of the requirement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from simulated_runs import run_of
from simulated_starts import DEFAULT, QUANTITIES, WORLDS, limit_of, outcome

from r2bspec.judge.pipeline import judge
from r2bspec.judge.verdict import Verdict
from run_simulation import objective

MEDIAN_S = 0.02

RESEMBLE = "hardly show whether each resembles the one before"
UNSEEN = "may be of a kind not met"
HOUR = "another hour may differ"
BURSTS = "burst"
STALLS = "stall"

OF_STALLS = {"p99": BURSTS, "drop rate 1 %": BURSTS, "mean, throughput": STALLS}
SAID: dict[str, dict[str, str]] = {
    "messages resemble (0.99)": {"p99": BURSTS, "drop rate 1 %": BURSTS},
    "iterations resemble (0.5), 5 %": {"p99": RESEMBLE, "drop rate 1 %": RESEMBLE},
    "iterations resemble (0.8), 5 %": dict.fromkeys(QUANTITIES, RESEMBLE),
    "starts resemble (0.5), 2.7 %": {"p99": RESEMBLE, "drop rate 1 %": RESEMBLE},
    "stalls of 20 messages": OF_STALLS,
    "stalls of 40 messages": OF_STALLS,
    "1 iteration in 10 is slow": dict.fromkeys(QUANTITIES, UNSEEN),
    "1 start in 5 is slow": dict.fromkeys(QUANTITIES, UNSEEN),
    "the hour differs by 2.7 %": dict.fromkeys(QUANTITIES, HOUR),
}
"""The words that a wrong verdict has, by world and quantity, where the world is not held."""


@dataclass(frozen=True)
class Said:
    """Wrong verdicts, and how many of them have the words."""

    wrong: int
    told: int

    @property
    def share(self) -> float:
        return self.told / self.wrong if self.wrong else 1.0


def said(name: str, quantity: str, *, wrong: int, max_runs: int = 2000, seed: int = 5) -> Said:
    """Judge runs until there are so many wrong verdicts, and read them."""
    world, words = WORLDS[name], SAID[name][quantity]
    random, limit = np.random.default_rng(seed), limit_of(world, quantity)
    found = told = 0
    for _ in range(max_runs):
        values = world.run(random, DEFAULT)
        if not outcome(values, DEFAULT, quantity, limit):
            continue
        verdict = judged(values, quantity, limit)
        # Wrong fails are held in all worlds of bursts and stalls.
        if verdict.outcome != "pass" and (verdict.outcome != "fail" or words in {BURSTS, STALLS}):
            continue
        found += 1
        told += words in " ".join((*verdict.limits, *verdict.requirements[0].notes))
        if found == wrong:
            break
    return Said(found, told)


def judged(values: NDArray[np.float64], quantity: str, limit: float) -> Verdict:
    """The verdict on a run with these messages."""
    latency = values * MEDIAN_S
    text = f"latency.{quantity} < {limit * MEDIAN_S * 1e3:.6f} ms"
    if quantity == "drop rate 1 %":
        latency, text = np.where(values > limit, np.nan, latency), "drop_rate <= 1 %"
    if quantity == "mean, throughput":
        text = f"latency.mean < {limit * MEDIAN_S * 1e3:.6f} ms"
    return judge({"slo": objective(text)}, run_of(latency, DEFAULT.numbers))
