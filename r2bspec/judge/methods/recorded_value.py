"""Values that are compared with the limit as recorded: observations, sequential probes.

Observations
------------

Minimum, maximum, counts, and all with == or != are compared with the limit.

An observation describes this run, not the next one. The rule of three bounds what it may have
missed: if none of n messages broke a bound, up to about 3/n of all may, at 95 % confidence.

Sequential probes
-----------------

The probe is a sequential test with three outcomes and a stated error
(`r2bspec.judge.rate_decision`): it was stopped as soon as it was decided, and is undecided if it
was not in the longest time that a probe may take. Testing its samples again would test a sample
whose size the first test has chosen, so the recorded outcome counts:

    PASS            the rate was sustained
    FAIL            the backlog grew, messages were dropped, or a condition of the spec was not met
    INCONCLUSIVE    the probe was undecided
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from r2bspec.judge.measure.metric import Scope
from r2bspec.judge.measure.metric_values import metric_value, time_value
from r2bspec.judge.measure.samples import pool_segments
from r2bspec.judge.measure.units import show
from r2bspec.judge.requirement_case import Decision, RequirementCase, undecided, unmeasured
from r2bspec.judge.statistics.rule_of_three import zero_failure_bound
from r2bspec.judge.verdict import Outcome
from r2bspec.record.run_record import RunRecord


def judge_observation(case: RequirementCase, record: RunRecord) -> Decision:
    """Compare the observed value of all iterations with the limit."""
    value = observed_value(case)
    if value is None:
        return unmeasured(case, record) or undecided(
            f"{case.info.name} has no value in these iterations."
        )
    n = _count_messages(case)
    is_met = case.is_met(value)
    counts = is_met and n > 0 and _bounds_single_messages(case, value)
    rule = zero_failure_bound(n, case.confidence) if counts else None
    return Decision(
        outcome="pass" if is_met else "fail",
        method="observation",
        reason=_reason(case, value, n, rule),
        estimate=value,
        n=n,
        rule_of_three=rule,
    )


def observed_value(case: RequirementCase) -> float | None:
    """Return the value of all iterations: extremes of extremes, sums of counts, means of means."""
    if case.info.scope is Scope.ANATOMY:
        return time_value(case.info, np.concatenate(case.message_values), case.lost)
    return metric_value(case.info, case.monitor, pool_segments(case.iterations))


def _count_messages(case: RequirementCase) -> int:
    """Return the number of observed messages; for processes, which have none, of iterations."""
    info = case.info
    if info.scope is Scope.PLAYBACK:
        return sum(iteration.playback.sent for iteration in case.iterations)
    if info.scope is Scope.MONITOR and not info.metric.has_percentiles:
        return sum(sample.expected for sample in case.monitor_samples)
    if info.scope.of_messages:
        return sum(values.size for values in case.message_values) + case.lost
    return len(case.iterations)


def _bounds_single_messages(case: RequirementCase, value: float) -> bool:
    """Return whether the observation is that no single message broke the bound."""
    info = case.info
    if not info.scope.of_messages:
        return False
    return info.part in {"min", "max"} or (info.metric.counts_faults and value == 0)


def _reason(case: RequirementCase, value: float, n: int, rule: float | None) -> str:
    what = _observation_text(case, value, n)
    if rule is None:
        return f"{what}."
    return (
        f"{what}. This is an observation, not a proof: at {case.confidence_text} up to "
        f"{show(rule, 'share', 2)} of {case.info.metric.noun} may still break the limit."
    )


def _observation_text(case: RequirementCase, value: float, n: int) -> str:
    info = case.info
    if info.part in {"min", "max"}:
        extreme = "smallest" if info.part == "min" else "largest"
        if math.isinf(value):
            missed = sum(monitor_sample.missed for monitor_sample in case.monitor_samples)
            return f"{show(missed, 'count')} of {show(n, 'count')} outputs never arrived"
        of = f"{show(n, 'count')} {info.metric.noun}"
        if not info.scope.of_messages:
            of = f"{n} iteration{'s' if n > 1 else ''}"
        return f"The {extreme} in {of} is {show(value, info.unit)}"
    if info.dimension == "count":
        if case.monitor_samples[0].own_pace if case.monitor else case.iterations[0].live:
            count = len(case.iterations)
            return f"Observed {show(value, 'count')} in {count} iteration{'s' if count > 1 else ''}"
        return f"Observed {show(value, 'count')} in {show(n, 'count')} steps"
    return f"{info.name} is {show(value, info.unit)}"


_ANSWER_TEXTS: Final = {True: "was sustained", False: "was not sustained", None: "was undecided"}
_OUTCOMES: Final[dict[bool | None, Outcome]] = {True: "pass", False: "fail", None: "inconclusive"}

_REMEDY = (
    "Probe for longer (benchmark.search.probe), or offer a rate further from the graph's capacity."
)


def judge_sustained(case: RequirementCase, record: RunRecord) -> Decision:
    """Decide ``sustained`` by the last sequential probe of the rate."""
    probes = [
        probe
        for probe in record.sustained
        if case.at_hz is not None and math.isclose(probe.rate_hz, case.at_hz)
    ]
    if not probes:
        where = f" at {show(case.at_hz, 'Hz')}" if case.at_hz is not None else ""
        return undecided(f"This run has no probe{where}.", "Run the spec of this objective.")
    probe = probes[-1]
    said = f": {probe.reason}" if probe.reason else ""
    throughput = f"throughput {show(probe.delivered_hz, 'Hz')}"
    return Decision(
        outcome=_OUTCOMES[probe.holds],
        method="sequential probe",
        reason=f"{show(probe.rate_hz, 'Hz')} {_ANSWER_TEXTS[probe.holds]}{said} ({throughput}).",
        remedy=_REMEDY if probe.holds is None else "",
        estimate=probe.delivered_hz,
        n=1,
    )
