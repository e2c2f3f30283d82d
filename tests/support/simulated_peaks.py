"""Probes and searches of single servers and chains of known capacity, for promises and tables.

D is even, M is exponential; first how steps come, then how they are served.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from r2bspec.judge.rate_decision import Criterion
from r2bspec.judge.verdict import Outcome
from r2bspec.record.run_record import SearchRecord
from simulated_queues import SHALLOW, SUSTAINED, Searching, Server, probe

Kind = Literal["D/D/1", "D/M/1", "M/D/1", "M/M/1"]

PRECISION = 0.02

SERVERS: Final[dict[str, dict[str, float | int]]] = {
    "D/D/1": {},
    "D/D/1, queue of 10 that drops": {"depth": SHALLOW},
    "three D/D/1 in a row": {"stages": 3},
    "D/G/1, a fifth exponential": {"spread": 0.2},
    "D/M/1": {"spread": 1.0},
    "three D/M/1 in a row": {"spread": 1.0, "stages": 3},
}
"""What `Server` is made of in each of the worlds that are searched."""


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


@dataclass(frozen=True)
class Searched:
    """A search of a server of known capacity: its bracket in shares of that capacity."""

    record: SearchRecord
    capacity_hz: float
    played_s: float

    @property
    def lower(self) -> float:
        """The highest rate that held; 0 if none did."""
        return (self.record.holds_hz or 0.0) / self.capacity_hz

    @property
    def upper(self) -> float:
        """The lowest rate that did not hold; infinite if none failed."""
        return (self.record.fails_hz or np.inf) / self.capacity_hz

    @property
    def contains(self) -> bool:
        """Whether the capacity is in it; a rate is proven up to a quarter of the precision."""
        return self.lower <= 1 + PRECISION / 4 and self.upper > 1


def searched(world: str, about_hz: float, seed: int, *, seconds: float = 10.0) -> Searched:
    """Search from a tenth to five times a capacity near `about_hz`, which the seed chooses."""
    capacity_hz = about_hz * float(np.exp(np.random.default_rng(seed).uniform(-0.1, 0.1)))
    server = Server(capacity_hz, seed=seed, **SERVERS[world])  # type: ignore[arg-type]
    criterion = Criterion(precision=PRECISION)
    searching = Searching(server, criterion, seconds=seconds, stages=server.stages)
    record = searching.run(about_hz / 10, about_hz * 5)
    return Searched(record, capacity_hz, searching.played_s)
