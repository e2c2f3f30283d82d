"""How a peak rate is decided: by the bracket in which the search ended, unless it is refuted.

A search is made in one start, and its confidence is about that start.

The peak lies between the highest sustained rate and the lowest rate that was not sustained. A
bracket decides a bound that lies outside it, and only that. A lower end that was not proven by a
whole play, or that the iterations at the peak refute, decides nothing. If the graph is not steady,
both ends are moved apart by the ratio of its speeds: what lies further away is decided all the
same. If no rate failed, because the range of the search ended or the player could offer no more,
the peak has no upper bound. Undecided probes leave the bracket wide, and decide nothing within it.

Refutation
----------

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
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.affected_iterations import REMEDY
from r2bspec.judge.measure.sample_table import MonitorSamples
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.measure.units import show
from r2bspec.judge.requirement_case import Decision, RequirementCase, decide, undecided
from r2bspec.judge.statistics.binomial import lower_bound
from r2bspec.judge.statistics.t_interval import mean_interval
from r2bspec.judge.statistics.trend import trend
from r2bspec.judge.verdict import Outcome
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.record.run_record import RunRecord, SearchRecord


def judge_peak(case: RequirementCase, record: RunRecord) -> Decision:
    """Decide a requirement on ``peak.rate``."""
    search = record.search
    if search is None or not search.probes:
        return undecided(
            "This run did not search for a peak.", "Add benchmark.search to the spec and run again."
        )
    lower = search.holds_hz
    upper = search.upper_hz
    proven = lower if search.proof != "open" and not search.refuted else None
    at_least = _at_least(case, proven and proven / search.unsteady_ratio)
    # Every rate of the bracket, which ends before `upper`, is below the limit.
    below = upper is not None and upper * search.unsteady_ratio <= case.limit
    passes, fails = (below, at_least) if case.is_upper_bound else (at_least, below)
    outcome, sure = decide(passes=passes, fails=fails), bracket_confidence(search)
    return Decision(
        outcome=outcome,
        method="search bracket",
        reason=" ".join(
            [
                _bracket_text(search, lower, upper),
                *([f"It has {sure}."] if sure else ()),
                *(f"{doubt}." for doubt in peak_doubts(search)),
            ]
        ),
        remedy=_remedy(search) if outcome == "inconclusive" else "",
        estimate=lower,
        lower=proven,
        upper=upper,
        n=len(search.probes),
        untested=_other_start_text(case, outcome, proven, upper),
    )


_STARTS_DIFFER: Final = 1.1
"""Peaks of starts of one graph differ by 3 to 5 % and hardly by more than this factor."""


def _other_start_text(
    case: RequirementCase, outcome: Outcome, lower: float | None, upper: float | None
) -> str:
    """Return that another start may decide otherwise, where the limit is close to the bracket."""
    above = (outcome == "fail") == case.is_upper_bound
    end, limit = lower if above else upper, case.limit
    if outcome == "inconclusive" or not end or limit <= 0:
        return ""
    if (end / limit if above else limit / end) > _STARTS_DIFFER:
        return ""
    return (
        "The search was made in one start, and starts of one graph often differ by 3 to 5 %: "
        "another start may decide otherwise."
    )


def bracket_confidence(search: SearchRecord) -> str:
    """Return ``95 % confidence of one start, for what recurs within 28 s`` or similar, or nothing.

    A search is made in one start. If others took a part of the time of every play, no recurring
    stop is excluded.
    """
    if not search.shown or not search.confidence:
        return ""
    recurs = show(search.recurs_s, "s", 2)
    met = f"for what recurs within {recurs}" if search.recurs_s else "stops apart"
    return f"{show(search.confidence, 'share', 4)} confidence of one start, {met}"


def _at_least(case: RequirementCase, lower: float | None) -> bool:
    """Return whether every rate of the bracket lies on the high side of the limit."""
    if lower is None:
        return False
    # '<' and '>=' share one boundary, '<=' and '>' the other.
    return lower >= case.limit if case.requirement.op in {"<", ">="} else (lower > case.limit)


def _bracket_text(search: SearchRecord, lower: float | None, upper: float | None) -> str:
    probes = f"{len(search.probes)} probe{'s' if len(search.probes) > 1 else ''}"
    if lower is None:
        lowest = min(probe.rate_hz for probe in search.probes)
        return (
            f"{probes}: even the lowest rate, {show(lowest, 'Hz')}, was not sustained"
            f"{_undecided_text(search)}."
        )
    if upper is not None:
        others = _interference_text(search)
        between = f"{_undecided_text(search)}{f'; {others}' if others else ''}"
        played = any(probe.rate_hz == search.fails_hz for probe in search.probes)
        above = "was not" if played else "is above the capacity"
        return (
            f"{probes}: {show(lower, 'Hz')} {_kept(search)}, {show(upper, 'Hz')} {above}{between}."
        )
    why = {
        "range": "the upper end of the search range",
        "player": "the highest rate that the player reached",
        "interference": _interference_text(search),
    }.get(search.limited_by, "then the search was interrupted")
    return f"{probes}: {show(lower, 'Hz')} {_kept(search)}, {why}."


def _kept(search: SearchRecord) -> str:
    return "was not shown to be sustained" if search.proof == "open" else "was sustained"


def peak_doubts(search: SearchRecord) -> tuple[str, ...]:
    """Return why a bracket has no confidence, without full stops; empty if it has."""
    doubts: list[str] = []
    if search.proof == "open":
        doubts.append("No rate was confirmed when it was played whole")
    elif search.proof == "probes":
        lost = ""
        if search.lost_at_most is not None:
            lost = f", at most {show(search.lost_at_most, 'share', 2)} lost"
        doubts.append(f"Only in probes of {show(search.proof_s, 's')}{lost}")
    doubts += [f"Not steady: {reason}" for reason in search.unsteady]
    if search.refuted:
        doubts.append(search.refuted[:1].upper() + search.refuted[1:])
    return tuple(doubts)


def _undecided_text(search: SearchRecord) -> str:
    """Return the undecided rates between the ends of the bracket."""
    rates = search.open_hz
    if not rates:
        return ""
    range_ = " to ".join(show(rate, "Hz") for rate in dict.fromkeys((rates[0], rates[-1])))
    return f"; {range_} was undecided"


def _interference_text(search: SearchRecord) -> str:
    """Return what others did while rates in the bracket, or above it, were probed."""
    if search.limited_by != "interference":
        return ""
    return f"during the probes above it {', '.join(search.disturbed)}"


def _remedy(search: SearchRecord) -> str:
    if search.limited_by == "interference":
        return REMEDY
    if search.refuted or search.proof == "open":
        return "Require a lower rate to be sustained, or search again with longer probes."
    if search.unsteady:
        return "Find out why the graph is not steady, or require a rate to be sustained."
    if search.open_hz:
        return "Probe for longer (benchmark.search.probe), or change the limit."
    match search.limited_by:
        case "range":
            return "Raise benchmark.search.max beyond the limit."
        case "player":
            return "Use a faster machine for the player, or smaller messages."
        case "interrupted":
            return "Run again and let the search finish."
        case _:
            return "Make benchmark.search.precision finer, or change the limit."


_SKIPPED_DIVISOR = 3
_MIN_OUTPUTS = 20


def with_refuted_peak(samples: RunSamples) -> RunSamples:
    """Return the samples, with the refutation of the peak in their record if there is one."""
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
        iteration
        for rate_hz, iterations in samples.iterations.items()
        if math.isclose(rate_hz, peak_hz)
        for iteration in iterations
    ]
    confidence = 1 - (1 - (search.confidence or CONFIDENCE)) / 2
    for name in samples.monitors:
        seen = [sample.monitors[name] for sample in played if name in sample.monitors]
        reason = _grows(seen, search, confidence, peak_hz) or _loses(seen, search, confidence)
        if reason:
            number = f"{len(seen)} iterations" if len(seen) > 1 else "the iteration"
            return f"{number} at {show(peak_hz, 'Hz')} refute it: {reason}"
    return ""


def _grows(
    seen: Sequence[MonitorSamples], search: SearchRecord, confidence: float, peak_hz: float
) -> str:
    latencies = [_latencies(sample) for sample in seen]
    usable = [latency for latency in latencies if latency[0].size >= _MIN_OUTPUTS]
    if not usable or len(usable) < len(latencies):
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
    """Return publication times and latencies of the later steps, in seconds."""
    answered = np.flatnonzero(seen.came)
    kept = answered[answered.size // _SKIPPED_DIVISOR :]
    published = seen.outputs["published_ns"][kept]
    return published / 1e9, (seen.outputs["received_ns"][kept] - published) / 1e9


def _loses(seen: Sequence[MonitorSamples], search: SearchRecord, confidence: float) -> str:
    expected, missed = (
        sum(sample.expected for sample in seen),
        sum(sample.missed for sample in seen),
    )
    if not expected or search.max_lost is None:
        return ""
    if lower_bound(missed, expected, confidence) <= search.max_lost:
        return ""
    return f"{missed} of {expected} messages were lost"
