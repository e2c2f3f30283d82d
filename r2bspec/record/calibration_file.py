"""The noise of a benchmark on a machine, measured by `r2bspec calibrate`, in a companion file.

``NAME.noise.json`` is in the folder of ``NAME.r2b.yaml``, may be committed with it, and contains
one calibration per benchmark (each case of a matrix is one) and kind of machine.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

import msgspec

from r2bspec.record.files import RecordError, write_atomically
from r2bspec.safe_io.safe_json import read_json

CALIBRATION_SUFFIX: Final = ".noise.json"

_SPEC_SUFFIXES = (".r2b.yaml", ".yaml", ".yml")


class MetricNoise(msgspec.Struct, frozen=True, kw_only=True):
    """The difference of a metric within a pair of runs of an unchanged graph.

    Attributes:
        at_hz: the offered rate; None for the whole run.
        monitor: None for a metric without a monitor.
        deviation: the standard deviation of the logarithm of second over first; 0.02 is 2 %.
        upper: its upper bound at the confidence of the calibration.
        bias: the mean of the logarithms, which should be 0 within its error.
        biased: whether it is not.
        n: the number of pairs.
        margins: by the number of pairs of a comparison, the smallest regression that is detected,
            and the smallest margin with which an unchanged graph passes, with a probability of
            90 %: a logarithm, calculated from `upper`.
    """

    at_hz: float | None
    monitor: str | None
    metric: str
    deviation: float
    upper: float
    bias: float
    biased: bool
    n: int
    margins: dict[str, float]

    def margin(self, pairs: int) -> float | None:
        """The smallest margin for this number of pairs, or for the next smaller known one."""
        pair_counts = [int(number) for number in self.margins if int(number) <= pairs]
        return self.margins[str(max(pair_counts))] if pair_counts else None


class Calibration(msgspec.Struct, frozen=True, kw_only=True):
    """The calibration of a benchmark on one kind of machine.

    Attributes:
        machine: its description.
        run_id: of the comparison from which it was calculated.
        plan: identifies the measurement.
    """

    machine: str
    run_id: str
    started_at: str
    plan: str
    confidence: float
    metrics: tuple[MetricNoise, ...]


class CalibrationFile(msgspec.Struct, frozen=True, kw_only=True):
    """Calibrations by the name of the benchmark, then by the fingerprint of the machine."""

    r2bspec_noise: Literal[1] = 1
    benchmarks: dict[str, dict[str, Calibration]] = {}


def calibration_path(spec_file: Path) -> Path:
    """The path of the noise file of a spec."""
    name = spec_file.name
    for suffix in _SPEC_SUFFIXES:
        if name.endswith(suffix):
            name = name.removesuffix(suffix)
            break
    return spec_file.with_name(f"{name}{CALIBRATION_SUFFIX}")


def read_calibration_file(path: Path) -> CalibrationFile | None:
    """Read a noise file; None if there is none.

    Raises:
        RecordError: it is damaged, or has an unknown version.
    """
    try:
        return read_json(path, CalibrationFile)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}") from error
    except msgspec.DecodeError as error:
        raise RecordError(
            f"{path} cannot be used: {error}",
            hint="Remove it, and write a new one with 'r2bspec calibrate SPEC'.",
        ) from error


def add_calibration(path: Path, benchmark: str, host: str, found: Calibration) -> None:
    """Add or replace a calibration in a noise file.

    Raises:
        RecordError: the file is damaged, or cannot be written.
    """
    before = read_calibration_file(path) or CalibrationFile()
    hosts = {**before.benchmarks.get(benchmark, {}), host: found}
    after = CalibrationFile(benchmarks={**before.benchmarks, benchmark: hosts})
    text = msgspec.json.format(msgspec.json.encode(after, order="sorted"), indent=1)
    write_atomically(path, text + b"\n")
