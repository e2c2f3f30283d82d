"""The newest result of a spec among the run folders below a folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from r2bspec.api import folder_name
from r2bspec.compare.load_results import read_result
from r2bspec.errors import R2bspecError
from r2bspec.judge.result import Result
from r2bspec.measure.units import show

_MAX_TRIED: Final = 5
"""Newer folders without a result that are passed over: of runs that were interrupted."""


@dataclass(frozen=True, slots=True)
class LatestResult:
    """A result in one line, and the folder that has it."""

    text: str
    folder: Path


def latest_result(name: str, folder: Path) -> LatestResult | None:
    """The newest result of a benchmark; None if there is none.

    Args:
        name: of the benchmark, with its case.
        folder: in which runs were started, with the folder ``runs``.
    """
    beginning = f"{folder_name(name)}-"
    try:
        found = [each for each in (folder / "runs").iterdir() if each.name.startswith(beginning)]
        found.sort(key=lambda each: each.stat().st_mtime, reverse=True)
    except OSError:
        return None
    for each in found[:_MAX_TRIED]:
        try:
            result = read_result(each / "result.json")
        except R2bspecError:
            continue
        if result.name == name:
            return LatestResult(_one_line(result), each)
    return None


def _one_line(result: Result) -> str:
    latency = _first_p99_s(result)
    measured = f"p99 {show(latency, 's')}, " if latency is not None else ""
    return f"last result: {measured}{result.verdict.outcome.upper()}"


def _first_p99_s(result: Result) -> float | None:
    """The p99 of the first monitor at the first rate, in seconds."""
    values = (
        monitor.latency.p99
        for rate in result.metrics.rates
        for monitor in rate.pooled.monitors.values()
    )
    return next((each for each in values if each is not None), None)
