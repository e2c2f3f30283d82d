"""Probes and searches of single servers and chains of known capacity, for promises and tables.

D is even, M is exponential; first how steps come, then how they are served.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from r2bspec.judge.rate_decision import Criterion
from r2bspec.judge.verdict import Outcome
from simulated_queues import SUSTAINED, Server, probe

Kind = Literal["D/D/1", "D/M/1", "M/D/1", "M/M/1"]

PRECISION = 0.02


def outcome(kind: Kind, load: float, *, seconds: float, seed: int) -> Outcome | Literal["invalid"]:
    """What the verdict on a rate is, at a share `load` of a capacity of 100 Hz.

    ``invalid`` where random arrivals were too few for the rate that was asked for.
    """
    rate_hz = load * 100.0
    random = np.random.default_rng(seed)
    # Random arrivals are drawn for as long as the rate is played.
    steps = max(round(seconds * rate_hz), Criterion(precision=PRECISION).messages_without_loss)
    found = probe(
        Server(100.0, spread=1.0 if kind[2] == "M" else 0.0, seed=seed),
        rate_hz,
        seconds=seconds,
        play=SUSTAINED,
        arrivals_s=np.cumsum(random.exponential(1 / rate_hz, steps)) if kind[0] == "M" else None,
    ).judgement
    if found.limited_by_player:
        return "invalid"
    return "inconclusive" if found.holds is None else "pass" if found.holds else "fail"
