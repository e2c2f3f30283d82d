"""The latency of one monitor at one rate as HdrHistogram's percentile distribution.

Programs that plot such files read one distribution from each: if a run has several, the path of the
report has placeholders, ``--report 'hdrhistogram=latency-{monitor}-{rate}.hgrm'``. Values are
milliseconds and exact, because all of them were recorded. The format cannot express lost messages;
a comment at the end counts them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from r2bspec.compare.report_input import ReportInput
from r2bspec.measure.samples import known_latencies
from r2bspec.measure.times import rank
from r2bspec.report.errors import ReportError

_TICKS_PER_HALF = 5
"""Lines for each halving of the distance to 100 %, as HdrHistogram's own tools write."""


def render(report_input: ReportInput) -> bytes:
    """The table with its two lines of summary.

    Raises:
        ReportError: there is not exactly one distribution, or no samples.
    """
    report_input.require_run("the format hdrhistogram")
    values, lost = _values(report_input)
    return "\n".join([*_lines(np.sort(values) * 1e3, lost), ""]).encode()


def _values(report_input: ReportInput) -> tuple[NDArray[np.float64], int | None]:
    """The latencies, and the number of lost messages; None where it is unknown."""
    samples = report_input.samples
    found = [
        (rate, monitor)
        for rate in sorted(samples.iterations if samples else ())
        for monitor in (samples.monitors if samples else ())
        if report_input.rate_hz in {None, rate} and report_input.monitor in {None, monitor}
    ]
    if samples is None or len(found) != 1:
        raise ReportError(
            f"hdrhistogram has one monitor at one rate, but this run has {len(found)} of them",
            hint="Use placeholders in the path: "
            "--report 'hdrhistogram=latency-{monitor}-{rate}.hgrm'",
        )
    ((rate, monitor),) = found
    seen = [one.monitors[monitor] for one in samples.iterations[rate]]
    lost = None if seen[0].live else sum(one.missed for one in seen)
    return known_latencies(seen), lost


def _lines(values: NDArray[np.float64], lost: int | None) -> Iterator[str]:
    n = int(values.size)
    yield "       Value     Percentile TotalCount 1/(1-Percentile)"
    yield ""
    for share in _shares(n):
        k = rank(share, n) if share else 1
        # Equal values share one line, whose count includes all of them.
        count = int(np.searchsorted(values, values[k - 1], side="right"))
        inverse = f"{1 / (1 - share):14.2f}" if share < 1 else f"{'inf':>14}"
        yield f"{values[k - 1]:12.6f} {share:2.12f} {count:10d} {inverse}"
    mean, deviation = (float(values.mean()), float(values.std())) if n else (0.0, 0.0)
    largest = float(values[-1]) if n else 0.0
    yield f"#[Mean    = {mean:12.6f}, StdDeviation   = {deviation:12.6f}]"
    yield f"#[Max     = {largest:12.6f}, Total count    = {n:12d}]"
    if lost is not None:
        yield f"#[Lost    = {lost:12d}]"


def _shares(n: int) -> Iterator[float]:
    """0, then five steps to one half, five more to three quarters, and so on; 1 at last."""
    share = 0.0
    while n and rank(share, n) < n:
        yield share
        halvings = math.floor(math.log2(1 / (1 - share)) + 1e-9) + 1
        share += 1 / (_TICKS_PER_HALF * 2**halvings)
    if n:
        yield 1.0
