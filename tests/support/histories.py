"""Histories of results whose true changes are given."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import numpy as np

from r2bspec.judge.judge_run import result_of, to_json
from r2bspec.judge.measure.distribution import Distribution
from r2bspec.judge.measure.metrics import MetricValue, SegmentMetrics
from r2bspec.judge.result import Result
from r2bspec.record.graph_identity import GraphIdentity, Revision
from report_runs import skewed
from run_simulation import Played, Simulation


def some_result(folder: Path, rates: Sequence[float] = (30,)) -> Result:
    """Return a result of two iterations at each rate."""
    played = [Played(rate, skewed(60, 0.02, index)) for rate in rates for index in range(2)]
    return result_of(Simulation(segments=played).write(folder))


def commit(number: int) -> str:
    """Return the name of a commit."""
    return hashlib.sha1(str(number).encode(), usedforsecurity=False).hexdigest()


def result_of_commit(result: Result, number: int, factor: float) -> Result:
    """Return the result of another commit, an hour later, whose values are larger by a factor."""

    def scaled(value: MetricValue) -> MetricValue:
        if isinstance(value, Distribution):
            parts = msgspec.structs.asdict(value)
            numbers = {k: v * factor for k, v in parts.items() if isinstance(v, float)}
            return msgspec.structs.replace(value, **numbers)
        return value * factor if isinstance(value, float) else value

    def played(segment: SegmentMetrics) -> SegmentMetrics:
        monitors = {
            name: msgspec.structs.replace(
                seen, values={key: scaled(value) for key, value in seen.values.items()}
            )
            for name, seen in segment.monitors.items()
        }
        return msgspec.structs.replace(segment, monitors=monitors)

    rates = tuple(
        msgspec.structs.replace(rate, iterations=tuple(map(played, rate.iterations)))
        for rate in result.metrics.rates
    )
    revision = Revision(commit(number), dirty=False)
    return msgspec.structs.replace(
        result,
        run_id=f"run-{number}",
        started_at=(datetime(2026, 1, 1, tzinfo=UTC) + timedelta(hours=number)).isoformat(),
        metrics=msgspec.structs.replace(result.metrics, rates=rates),
        identity=GraphIdentity(digest="", nodes={}, revision=revision),
    )


def write_history(folder: Path, result: Result, factors: Sequence[float]) -> None:
    """Write a result for each factor."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, factor in enumerate(factors):
        made = result_of_commit(result, number, factor)
        (folder / f"{number:04}.json").write_bytes(to_json(made))


def noisy(number: int, steps: dict[int, float], deviation: float = 0.02) -> list[float]:
    """Return factors around 1, and around another value from each given place on."""
    chance = np.random.default_rng(number)
    level, factors = 1.0, []
    for place in range(number):
        level = steps.get(place, level)
        factors.append(level * chance.normal(1, deviation))
    return factors
