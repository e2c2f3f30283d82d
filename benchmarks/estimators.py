"""Which estimate of the effective number of messages keeps its promise on recorded latencies.

    PYTHONPATH=. python benchmarks/estimators.py RUN [RUN ...]

A run folder (or a ``.npy`` of shape (iterations, messages), NaN where lost) is a long recording of
one graph on one machine. Its own percentile, over everything, is taken for the truth, and a run is
made of pieces of it: as many stretches as a run has iterations, each from a place of its own, at
random. Requirements lie exactly on the truth: a PASS is wrong, and so is a FAIL. Both should come
in at most 5 % of such runs.

Only recordings of one graph under one load make sense; of those that hold few bursts the truth
itself is uncertain, and the table counts that as error.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from measuring import show, table
from numpy.typing import NDArray

from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.judge.measure.times import rank
from r2bspec.judge.statistics import effective_sample_size
from r2bspec.judge.statistics.binomial import lower_bound, upper_bound
from r2bspec.judge.statistics.percentile_interval import RankedMessages
from r2bspec.record.run_folder import open_run

Latencies = NDArray[np.float64]
"""Seconds, one row for each iteration or piece; infinite where nothing came."""

Flags = NDArray[np.bool_]
"""Which messages of each piece are over the limit, shape (pieces, messages)."""


@dataclass(frozen=True)
class Drawn:
    """A run made of a recording."""

    latency: Latencies
    over: Flags


_CONFIDENCE = 0.95
_RUNS = 600


def one_by_one(_: Flags) -> float:
    """Every message for itself: F = 1."""
    return 1.0


def lag_1(flags: Flags) -> float:
    """(1 + r) / (1 - r) with the lag-1 autocorrelation of the flags, within pieces."""
    deviations = flags - flags.mean()
    variance = float((deviations**2).mean())
    if not variance:
        return 1.0
    r = float((deviations[:, 1:] * deviations[:, :-1]).mean()) / variance
    return max(1.0, (1 + r) / (1 - r)) if r < 1 else float(flags.size)


def batches(length: int) -> Callable[[Flags], float]:
    """Batch means: the variance of the counts of batches of a length over the binomial one."""

    def of(flags: Flags) -> float:
        p = float(flags.mean())
        number = flags.shape[1] // length
        if not 0 < p < 1 or number < 1:
            return 1.0
        cut = flags[:, : number * length].reshape(-1, length)
        return max(1.0, float(cut.mean(axis=1).var(ddof=1)) * length / (p * (1 - p)))

    return of


def used(flags: Flags) -> float:
    """What verdicts use: the largest of the three."""
    sizes = np.full(flags.shape[0], flags.shape[1])
    return effective_sample_size.effective_sample_of_rows(flags, sizes).inflation


ESTIMATORS: dict[str, Callable[[Flags], float]] = {
    "one by one": one_by_one,
    "lag-1": lag_1,
    "batches of 10": batches(10),
    "batches of 50": batches(50),
    "as used": used,
}


JUDGED = "as judged"


def judged(run: Drawn, limit: float, truth: float) -> tuple[bool, bool]:
    """Whether a run passes, and whether it fails, by counts and levels, as verdicts do it."""
    design = effective_sample_size.SampleDesign(allowed=truth, confidence=_CONFIDENCE)
    ranked = RankedMessages(list(run.latency), design)
    sample = ranked.effective_sample(int(run.over.sum()))
    levels = ranked.level_margin(1 - truth, _CONFIDENCE)
    margin = levels.half if levels is not None else 0.0
    estimate = float(ranked.ordered[rank(1 - truth, ranked.n) - 1])
    counts = sample.bad_messages, sample.messages, _CONFIDENCE
    return (
        upper_bound(*counts) <= truth and estimate + margin <= limit,
        lower_bound(*counts) > truth and estimate - margin > limit,
    )


def recorded(path: Path) -> Iterator[tuple[str, Latencies]]:
    """What a recording holds: a name, and latencies, for each rate and monitor."""
    if path.suffix == ".npy":
        yield path.stem, np.where(np.isnan(found := np.load(path)), np.inf, found)
        return
    samples = read_samples(open_run(path))
    for rate, iterations in samples.iterations.items():
        for monitor in samples.monitors:
            rows = [one.monitors[monitor].in_order("latency", np.inf) for one in iterations]
            shortest = min(row.size for row in rows)
            name = f"{path.name}, {rate:g} Hz"
            if len(samples.monitors) > 1:
                name += f", {monitor}"
            yield name, np.stack([row[:shortest] for row in rows])


def wrong(
    latency: Latencies, quantile: float, pieces: int, messages: int, runs: int = _RUNS
) -> dict[str, tuple[float, float]]:
    """Shares of runs that pass and that fail wrongly, by estimator.

    Args:
        latency: the recording.
        quantile: that is required, such as 0.99; the limit is the recording's own.
        pieces: iterations of a run.
        messages: of an iteration.
        runs: how many are made of it.

    Returns:
        Nothing where the quantile falls on a lost message: there is no such limit.
    """
    # An observed value, and over the limit is what lies beyond it: the share of these is known.
    ordered = np.sort(latency, axis=None)
    over = latency > ordered[rank(quantile, ordered.size) - 1]
    truth = float(over.mean())
    if not truth:
        return {}
    random = np.random.default_rng(1)
    limit = float(ordered[rank(quantile, ordered.size) - 1])
    counts = {name: [0, 0] for name in (*ESTIMATORS, JUDGED)}
    for _ in range(runs):
        rows = random.integers(0, over.shape[0], pieces)
        starts = random.integers(0, over.shape[1] - messages + 1, pieces)
        drawn = rows[:, np.newaxis], starts[:, np.newaxis] + np.arange(messages)
        run = Drawn(latency[drawn], over[drawn])
        n, bad = run.over.size, int(run.over.sum())
        for name, estimator in ESTIMATORS.items():
            f = min(estimator(run.over), float(n))
            counts[name][0] += upper_bound(bad / f, n / f, _CONFIDENCE) <= truth
            counts[name][1] += lower_bound(bad / f, n / f, _CONFIDENCE) > truth
        passes, fails = judged(run, limit, truth)
        counts[JUDGED][0] += passes
        counts[JUDGED][1] += fails
    return {name: (passed / runs, failed / runs) for name, (passed, failed) in counts.items()}


CASES = ((0.5, 10, 30), (0.9, 10, 100), (0.99, 10, 300))
"""Quantile, pieces and messages of each."""


def rows(paths: Sequence[Path]) -> Iterator[list[str]]:
    """Wrong passes / wrong fails, in % of runs."""
    for path in paths:
        for name, latency in recorded(path):
            for quantile, pieces, messages in CASES:
                if messages > latency.shape[1]:
                    continue
                if not (found := wrong(latency, quantile, pieces, messages)):
                    continue
                cells = [
                    f"{100 * passed:.0f} / {100 * failed:.0f}" for passed, failed in found.values()
                ]
                yield [name, f"p{100 * quantile:g} of {pieces} x {messages}", *cells]


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    recordings = [Path(each) for each in sys.argv[1:]]
    for line in table(("recording", "asked", *ESTIMATORS, JUDGED), rows(recordings)):
        show(line)
