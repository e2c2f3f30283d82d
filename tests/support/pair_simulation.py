"""Folders of comparisons that never happened: each run is a simulated one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.statistics.t_interval import pair_orders
from r2bspec.language.spec import Objective
from r2bspec.plan.canonical_json import canonical_json, plan_hash
from r2bspec.plan.plan import GatePlan, Plan, PlayPlan
from r2bspec.record.comparison_folder import (
    ComparisonFolder,
    PairedComparison,
    PairRecord,
    PairsRecord,
    open_comparison,
)
from run_simulation import EPOCH_NS, Played, Simulation, objective

RATE_HZ = 30.0

STEPS = 30

NO_REGRESSION = {
    "no_regression": objective("latency.p50 <= 105 % of baseline"),
    "fast": objective("latency.p50 < 100 ms"),
}


def latencies(level_s: float, steps: int = STEPS) -> NDArray[np.float64]:
    """Latencies of one run about a level, the same shape each time."""
    return level_s * (1 + 0.05 * np.sin(np.arange(steps)))


@dataclass(frozen=True)
class Comparison:
    """A comparison to be written: the median latency of each run in seconds, pair by pair.

    Attributes:
        again: what came out where a pair was played again, by its number.
        unusable: pairs that could not be judged at first, by number, and why.
        load: what others did while pairs were played, by number, as `Simulation` has it.
        fresh: pairs that were played to confirm a failure, likewise.
    """

    base: Sequence[float]
    head: Sequence[float]
    objectives: Mapping[str, Objective] = field(default_factory=lambda: NO_REGRESSION)
    again: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    unusable: Mapping[int, str] = field(default_factory=dict)
    load: Mapping[int, Mapping[str, float]] = field(default_factory=dict)
    fresh: Sequence[tuple[float, float]] = ()
    control: bool = False
    planned: int = 0
    status: Literal["complete", "incomplete"] = "complete"
    reason: str = ""
    template: Simulation = field(default_factory=Simulation)

    def write(self, path: Path) -> PairedComparison:
        """Write the folder, and open it."""
        folder = ComparisonFolder.create(path)
        plan = self.plan()
        folder.write_plan(canonical_json(plan).decode())
        folder.write_base_plan(plan)
        folder.write_spec("r2bspec: 1\nname: simulated\n")
        pairs: list[PairRecord] = []
        orders = pair_orders(len(self.base), seed=1)
        for number, (base_s, head_s) in enumerate(zip(self.base, self.head, strict=True), start=1):
            pair = PairRecord(
                number=number,
                order=orders[number - 1],
                base=f"base/{number:03d}",
                head=f"head/{number:03d}",
                unusable=self.unusable.get(number, ""),
            )
            pairs.append(self._play(path, pair, base_s, head_s))
            if number in self.again:
                names = {side: f"{side}/{number:03d}-again" for side in ("base", "head")}
                second = msgspec.structs.replace(pair, again=True, unusable="")
                second = msgspec.structs.replace(second, **names)
                pairs.append(self._play(path, second, *self.again[number]))
        for number, (base_s, head_s) in enumerate(self.fresh, start=len(self.base) + 1):
            pair = PairRecord(
                number=number, order="AB", base=f"base/{number:03d}", head=f"head/{number:03d}"
            )
            pairs.append(self._play(path, pair, base_s, head_s))
        folder.write_pairs(
            PairsRecord(
                run_id="fedcba9876543210",
                head_plan=plan_hash(plan),
                base_plan=plan_hash(plan),
                against="" if self.control else "other.r2b.yaml",
                control=self.control,
                seed=1,
                planned=self.planned or len(self.base),
                started_at="2026-01-01T00:00:00+00:00",
                ended_at="2026-01-01T00:10:00+00:00",
                status=self.status,
                reason=self.reason,
                pairs=tuple(pairs),
                confirmed_from=len(self.base) if self.fresh else 0,
                fresh=len(self.fresh),
                differences=() if self.control else ("processes.relay.nice: 0 -> 5",),
            )
        )
        return open_comparison(path)

    def plan(self) -> Plan:
        """The plan of both sides."""
        return msgspec.structs.replace(
            replace(self.template, objectives=self.objectives).plan(),
            play=(PlayPlan(rate_hz=RATE_HZ, duration_ns=10**9, iterations=len(self.base) or 1),),
            gate=GatePlan(),
        )

    def _play(self, path: Path, pair: PairRecord, base_s: float, head_s: float) -> PairRecord:
        sides = [(pair.base, base_s), (pair.head, head_s)]
        for name, level_s in sides if pair.order == "AB" else reversed(sides):
            # Runs follow each other on one clock: as many seconds after the first as there are.
            before = sum(1 for _ in path.glob("*/*/record.json"))
            simulated = replace(
                self.template,
                segments=[Played(RATE_HZ, latencies(level_s))],
                objectives=self.objectives,
                start_ns=EPOCH_NS + before * 10 * 10**9,
                interference=self.load.get(pair.number, self.template.interference),
            )
            simulated.write(path / name)
        return pair
