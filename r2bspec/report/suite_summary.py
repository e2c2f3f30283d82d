"""Several runs as one summary: a row for each spec and rate."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Final, Literal

import msgspec

from r2bspec.errors import R2bspecError
from r2bspec.exit_status import ExitStatus
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.report.headline import headline
from r2bspec.report.notes import notes_of_an_open_run
from r2bspec.report.report_wording import revisions

_SEVERITY: Final = (
    ExitStatus.OK,
    ExitStatus.INCONCLUSIVE,
    ExitStatus.RUN_FAILED,
    ExitStatus.FINDINGS_OR_FAILED,
    ExitStatus.USAGE,
    ExitStatus.INTERNAL_ERROR,
    ExitStatus.INTERRUPTED,
)
"""Exit statuses, the worst last: what a retry may mend is not as bad as what it cannot."""


_URGENCY: Final = ("pass", "inconclusive", "fail")
"""Outcomes of a requirement, the one that matters most last."""


class SuiteRow(msgspec.Struct, frozen=True, kw_only=True):
    """One monitor at one rate; times in seconds, None where there is no value.

    Attributes:
        offered_hz: 0 where the recording or the graph sets the rate; `pace` says which.
        peak_hz: of the search of the run, the same in each of its rows.
        ratio: to the base, of the metric `ratio_metric`: what decided, where several are required.
    """

    offered_hz: float
    pace: str
    monitor: str
    throughput_hz: float | None
    latency_p50_s: float | None
    latency_p99_s: float | None
    peak_hz: float | None
    ratio: float | None = None
    ratio_metric: str = ""


class SuiteRun(msgspec.Struct, frozen=True, kw_only=True):
    """One run of a suite.

    Attributes:
        name: of the benchmark, with its case.
        folder: the run folder; empty where nothing was run.
        outcome: of the verdict; ``error`` where the run failed, ``skipped`` after a failure.
        resumed: whether the run is an earlier one.
        host: of a fleet, that made it; empty on this host.
        line: the first line of its reports; empty where it has no result.
        gate: what its comparison with a base is to be read with, a sentence each.
        report: its page in HTML; empty where it has none.
        notes: the main ones on an inconclusive run; see `notes_of_an_open_run`.
        revision: of its code, with ``+dirty`` for changes that are not committed; empty where it
            is not known.
        base_revision: of the code that it was compared with; empty without a base.
    """

    name: str
    spec: str
    folder: str
    outcome: str
    reason: str
    exit_status: int
    resumed: bool = False
    host: str = ""
    rows: tuple[SuiteRow, ...] = ()
    line: str = ""
    gate: tuple[str, ...] = ()
    report: str = ""
    notes: tuple[str, ...] = ()
    revision: str = ""
    base_revision: str = ""


class SuiteSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Runs that were made one after the other, in their order.

    Attributes:
        exit_status: the worst of all; see `worst_status`.
        gate: what is gone from the specs of the base and allowed, a sentence each.
    """

    r2bspec_suite: Literal[1] = 1
    started_at: str
    ended_at: str
    machine: dict[str, str] = {}
    exit_status: int
    gate: tuple[str, ...] = ()
    runs: tuple[SuiteRun, ...]


def worst_status(statuses: Iterable[int]) -> ExitStatus:
    """The worst exit status; 0 for none."""
    by_number = {each.value: each for each in ExitStatus}
    found = [by_number[each] for each in statuses]
    return max(found, key=_severity, default=ExitStatus.OK)


def _severity(status: ExitStatus) -> int:
    return _SEVERITY.index(status) if status in _SEVERITY else len(_SEVERITY)


def run_with_result(
    result: Result,
    *,
    spec: str,
    folder: str,
    name: str = "",
    resumed: bool = False,
    host: str = "",
    report: str = "",
) -> SuiteRun:
    """A run that has a result."""
    revision, base_revision = revisions(result)
    return SuiteRun(
        name=name or result.name,
        spec=spec,
        folder=folder,
        outcome=result.verdict.outcome,
        reason=result.verdict.reason,
        exit_status=result.verdict.exit_code,
        resumed=resumed,
        host=host,
        rows=tuple(_rows(result)),
        line=headline(result),
        gate=result.gate,
        report=report,
        notes=notes_of_an_open_run(result),
        revision=revision,
        base_revision=base_revision,
    )


def run_with_error(
    error: R2bspecError,
    *,
    name: str,
    spec: str,
    folder: str = "",
    host: str = "",
    report: str = "",
) -> SuiteRun:
    """A run that failed, or a spec that could not be run."""
    return SuiteRun(
        name=name,
        spec=spec,
        folder=folder,
        outcome="error",
        reason=f"{error.code}: {error}" + (f". {error.hint}" if error.hint else ""),
        exit_status=error.exit_code,
        host=host,
        report=report,
    )


def _decisive_ratio(result: Result, rate_hz: float, monitor: str) -> RequirementVerdict | None:
    """The ratio to a base at a rate that matters most: one that failed, or else is open."""
    ratios = [
        requirement
        for requirement in result.verdict.requirements
        if requirement.compared is not None
        and requirement.monitor in {monitor, None}
        and math.isclose(requirement.at_hz or 0.0, rate_hz)
    ]
    return max(ratios, key=lambda ratio: _URGENCY.index(ratio.outcome), default=None)


def _rows(result: Result) -> Iterator[SuiteRow]:
    search = result.metrics.search
    for rate in result.metrics.rates:
        for monitor, seen in rate.pooled.monitors.items():
            compared = _decisive_ratio(result, rate.offered_hz, monitor)
            yield SuiteRow(
                offered_hz=rate.offered_hz,
                pace=rate.pace,
                monitor=monitor,
                throughput_hz=seen.throughput_hz,
                latency_p50_s=seen.latency.p50,
                latency_p99_s=seen.latency.p99,
                peak_hz=search.holds_hz if search is not None else None,
                ratio=compared.estimate if compared is not None else None,
                ratio_metric=compared.metric if compared is not None else "",
            )
    if search is not None and not result.metrics.rates:
        yield SuiteRow(
            offered_hz=0.0,
            pace="search",
            monitor="",
            throughput_hz=None,
            latency_p50_s=None,
            latency_p99_s=None,
            peak_hz=search.holds_hz,
        )
