"""The noise of a graph, from runs of it compared with itself, and the margins above it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from r2bspec.compare.errors import IncomparableError
from r2bspec.judge.baseline_comparison import TrackedMetric, run_value, tracked_metrics
from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.statistics.t_interval import noise_floor, smallest_detectable
from r2bspec.plan.comparability import measured_hash, pair_count
from r2bspec.record import calibration_file
from r2bspec.record.comparison_folder import PairedComparison
from r2bspec.record.graph_identity import describe_machine, fingerprint

MIN_PAIRS = 3
"""With fewer, the bound on the noise is more than five times the estimate."""

_PAIR_COUNTS = (3, 5, 10, 20, 40)
"""Numbers of pairs for which margins are computed, besides that of the spec."""


def compute_calibration(pairs: PairedComparison) -> calibration_file.Calibration:
    """The noise of every metric that has a value in each run.

    Args:
        pairs: a control: base and head are the same.

    Raises:
        IncomparableError: it is not a control, or has too few pairs.
        RecordError: a file of one of its runs is missing or damaged.
    """
    played = pairs.usable_pairs()
    if not pairs.record.control:
        raise IncomparableError(
            f"{pairs.folder} compares two graphs; a calibration compares a graph with itself",
            hint="Use 'r2bspec calibrate SPEC'.",
        )
    if len(played) < MIN_PAIRS:
        raise IncomparableError(
            f"{len(played)} pairs are too few for a calibration; {MIN_PAIRS} are needed",
            hint="Increase --pairs.",
        )
    base = [read_samples(pairs.run(pair, "base")) for pair in played]
    head = [read_samples(pairs.run(pair, "head")) for pair in played]
    merged = pairs.merged(played, "head")
    confidence = pairs.plan.gate.confidence
    numbers = sorted({*_PAIR_COUNTS, max(pair_count(pairs.plan), 2)})
    metrics: list[calibration_file.MetricNoise] = []
    for at_hz, monitor, info in tracked_metrics(merged, read_samples(merged)):
        ratios = _ratios((at_hz, monitor, info), base, head)
        if ratios is not None:
            metrics.append(_noise((at_hz, monitor, info), ratios, numbers, confidence))
    return calibration_file.Calibration(
        machine=describe_machine(merged.record.machine),
        run_id=pairs.record.run_id,
        started_at=pairs.record.started_at,
        plan=measured_hash(pairs.plan),
        confidence=confidence,
        metrics=tuple(metrics),
    )


def _ratios(
    where: TrackedMetric, base: Sequence[RunSamples], head: Sequence[RunSamples]
) -> list[float] | None:
    """Second over first of each pair; None if a value is missing, lost or 0."""
    at_hz, monitor, info = where
    values = [
        (run_value(info, monitor, at_hz, a), run_value(info, monitor, at_hz, b))
        for a, b in zip(base, head, strict=True)
    ]
    positive = [(a, b) for a, b in values if a and b]
    return [b / a for a, b in positive] if len(positive) == len(values) else None


def _noise(
    where: TrackedMetric, ratios: Sequence[float], numbers: Sequence[int], confidence: float
) -> calibration_file.MetricNoise:
    at_hz, monitor, info = where
    noise = noise_floor(ratios, confidence)
    return calibration_file.MetricNoise(
        at_hz=at_hz,
        monitor=monitor,
        metric=info.name,
        deviation=noise.deviation,
        upper=noise.upper,
        bias=noise.bias,
        biased=noise.biased,
        n=noise.n,
        margins={str(n): smallest_detectable(noise.upper, n, confidence) for n in numbers},
    )


def store_calibration(
    spec_file: Path, pairs: PairedComparison, found: calibration_file.Calibration
) -> Path:
    """Store a calibration in the companion file of its spec; returns the file.

    Raises:
        RecordError: the existing file is damaged, or cannot be written.
    """
    path = calibration_file.calibration_path(spec_file)
    machine = pairs.merged(pairs.usable_pairs(), "head").record.machine
    calibration_file.add_calibration(path, pairs.plan.name, fingerprint(machine), found)
    return path
