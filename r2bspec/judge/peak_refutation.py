"""Whether the iterations at the peak refute the bracket that the search found.

What is played at the lower end of the bracket must be sustained there, too. Two tests, with half
the error of the bracket each:

    the backlog grows    b_i, the slope of the latency over the time of publication, by least
                         squares on the later two thirds of iteration i, is above precision / 4 on
                         average: Student's t over the iterations. Of one iteration, the bound of
                         its slope (`r2bspec.judge.statistics.trend`).
    messages are lost    the lower Clopper-Pearson bound of the share that never arrived is above
                         what the search allowed.

Noise of the machine that makes a sustained rate fail is the business of `affected_iterations`; it
can only take away from what is claimed here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.statistics.binomial import lower_bound
from r2bspec.judge.statistics.t_interval import mean_interval
from r2bspec.judge.statistics.trend import trend
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.measure.samples import MonitorSamples, RunSamples
from r2bspec.measure.units import show
from r2bspec.record.run_record import SearchRecord

_SKIPPED_DIVISOR = 3
_MIN_OUTPUTS = 20


def with_refuted_peak(samples: RunSamples) -> RunSamples:
    """The samples, with the refutation of the peak in their record if there is one."""
    search = samples.record.search
    if search is None or search.holds_hz is None or search.refuted or not search.proof:
        return samples
    reason = _refutation(samples, search, search.holds_hz)
    if not reason:
        return samples
    refuted = msgspec.structs.replace(search, refuted=reason)
    return replace(samples, record=msgspec.structs.replace(samples.record, search=refuted))


def _refutation(samples: RunSamples, search: SearchRecord, peak_hz: float) -> str:
    played = [
        each
        for rate_hz, iterations in samples.iterations.items()
        if math.isclose(rate_hz, peak_hz)
        for each in iterations
    ]
    confidence = 1 - (1 - (search.confidence or CONFIDENCE)) / 2
    for name in samples.monitors:
        seen = [each.monitors[name] for each in played if name in each.monitors]
        reason = _grows(seen, search, confidence, peak_hz) or _loses(seen, search, confidence)
        if reason:
            number = f"{len(seen)} iterations" if len(seen) > 1 else "the iteration"
            return f"{number} at {show(peak_hz, 'Hz')} refute it: {reason}"
    return ""


def _grows(
    seen: Sequence[MonitorSamples], search: SearchRecord, confidence: float, peak_hz: float
) -> str:
    found = [_latencies(each) for each in seen]
    usable = [each for each in found if each[0].size >= _MIN_OUTPUTS]
    if not usable or len(usable) < len(found):
        return ""
    if len(usable) == 1:
        # One iteration is a play like a probe.
        line = trend(*usable[0], confidence)
        slope, lower = line.slope, line.lower
    else:
        slopes = [float(np.polyfit(at_s - at_s[0], late_s, 1)[0]) for at_s, late_s in usable]
        interval = mean_interval(slopes, confidence)
        slope, lower = interval.mean, interval.lower
    if lower <= search.precision / 4:
        return ""
    return f"the backlog grows by {peak_hz * slope / (1 + slope):.3g} messages/s"


def _latencies(seen: MonitorSamples) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """When the later steps were published, and how long each was under way, in seconds."""
    answered = np.flatnonzero(seen.steps.answered)
    kept = answered[answered.size // _SKIPPED_DIVISOR :]
    published = seen.steps.published_ns[kept]
    return published / 1e9, (seen.steps.received_ns[kept] - published) / 1e9


def _loses(seen: Sequence[MonitorSamples], search: SearchRecord, confidence: float) -> str:
    expected, missed = sum(each.expected for each in seen), sum(each.missed for each in seen)
    if not expected or search.max_lost is None:
        return ""
    if lower_bound(missed, expected, confidence) <= search.max_lost:
        return ""
    return f"{missed} of {expected} messages were lost"
