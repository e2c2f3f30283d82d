"""What no test can tell from a run, in words, where this run gives reason to say it.

A test takes account of what the run has shown. What no run can know, whatever it has shown, is the
same for all: docs/verdicts.md has it, and no verdict repeats it. Said are doubts that are those of
this run. Of bursts of bad messages it has met so many, and from few the longest cannot be known. A
mean or a throughput that is met by little would be missed with stalls that the run is too short to
have met. Starts that differ in latency may differ in what they lose, and few lost outputs do not
show it. One iteration does not show by how much iterations differ.
"""

from __future__ import annotations

import datetime
import math
import statistics
from collections.abc import Sequence
from operator import itemgetter
from typing import TYPE_CHECKING, Final

import numpy as np

from r2bspec.judge.measure.samples import (
    LOSS_SENSITIVE_FAMILIES,
    MonitorSamples,
    RunSamples,
    SegmentSamples,
    starts_of,
)
from r2bspec.judge.measure.units import show
from r2bspec.judge.methods import METHODS
from r2bspec.judge.statistics.effective_sample_size import bursts
from r2bspec.judge.statistics.percentile_interval import deviation_within
from r2bspec.judge.statistics.t_interval import by_start, deviation_bound
from r2bspec.judge.verdict import Outcome, RequirementVerdict
from r2bspec.language.benchmark_defaults import CONFIDENCE

if TYPE_CHECKING:
    from r2bspec.judge.requirement_case import RequirementCase

FEW_BURSTS: Final = 5
LONG_BURST: Final = 20.0
"""Messages; a PASS that allows for bursts of this mean length needs no note on them."""

_LONGER_BY: Final = {1: 19.5, 2: 5.6, 3: 3.7, 4: 2.9}
"""2 b / chi2, by the number b of bursts."""

WITHOUT_BURST: Final = "passed without a burst beyond"
"""Words of what is true of most runs of a kind; a short report leaves such sentences out."""


def particular_caveats(limits: Sequence[str]) -> Sequence[str]:
    """The limits of a verdict without the first, which every run has alike (`run_caveats`)."""
    return limits[1:]


def run_caveats(requirements: Sequence[RequirementVerdict], samples: RunSamples) -> tuple[str, ...]:
    """When and where it was played, and which bursts it met; nothing without requirements.

    Args:
        requirements: the verdicts on them.
        samples: the run.
    """
    if not requirements:
        return ()
    starts = f"{samples.starts} starts" if samples.starts > 1 else "one start"
    return (
        f"{_when_and_where(samples)}, in {starts}.",
        *_no_burst(requirements),
        *_moved_frequency(samples),
    )


def with_caveats(requirements: Sequence[RequirementVerdict]) -> tuple[RequirementVerdict, ...]:
    """The final verdicts on requirements, with what each of them cannot know."""
    return tuple(requirement.noted(*_few_bursts(requirement)) for requirement in requirements)


def _when_and_where(samples: RunSamples) -> str:
    """Such as ``Played between 10:02 and 10:04 UTC on 2026-01-31, on PROCESSOR``."""
    record = samples.record
    where = str(record.machine.get("cpu") or record.machine.get("architecture") or "")
    on = f" on {where}" if where else ""
    try:
        began, ended = (
            datetime.datetime.fromisoformat(time_text).astimezone(datetime.UTC)
            for time_text in (record.started_at, record.ended_at)
        )
    except ValueError:
        return f"Played{on} in one stretch of time"
    day = "" if began.date() == ended.date() else f"{ended:%Y-%m-%d} "
    return f"Played{on} between {began:%Y-%m-%d %H:%M} and {day}{ended:%H:%M} UTC"


def _no_burst(requirements: Sequence[RequirementVerdict]) -> tuple[str, ...]:
    """That passes met no burst beyond their limits, once for all of them."""
    verdicts = [
        (requirement.share.burst_tolerance, requirement)
        for requirement in requirements
        if requirement.share is not None
        and _depends_on_bursts(requirement)
        and requirement.share.over <= 1
        and requirement.share.burst_tolerance is not None
    ]
    if not verdicts:
        return ()
    shortest, gap = min(verdicts, key=lambda each: each[0])
    allowed = f"bursts of up to {show(shortest, '', 2)} {_counted(gap)} on average"
    if len(verdicts) == 1:
        text = f"{gap.text.strip()} {WITHOUT_BURST} the limit; it allows {allowed}."
        return (text,)
    text = (
        f"{len(verdicts)} requirements {WITHOUT_BURST} their limits; "
        f"{gap.text.strip()} allows the shortest, {allowed}."
    )
    return (text,)


_STEADY_FREQUENCY: Final = 1.05


def _moved_frequency(samples: RunSamples) -> tuple[str, ...]:
    """That the processors were faster in one iteration than in another at the same rate."""
    slowest, fastest = max(
        (_ends_of_frequency(played) for played in samples.iterations.values()),
        key=lambda ends: ends[1][0] / ends[0][0],
        default=((1.0, ""), (1.0, "")),
    )
    ratio = fastest[0] / slowest[0]
    if ratio <= _STEADY_FREQUENCY:
        return ()
    fixed = samples.record.machine.get("cpu_governor") == "performance"
    advice = "cool them, or switch turbo off" if fixed else "set their governor to 'performance'"
    text = (
        f"The processors ran at {show(fastest[0], 'Hz')} in {fastest[1]}, and at "
        f"{show(slowest[0], 'Hz')} in {slowest[1]}, which can make latencies "
        f"{show(ratio - 1, 'share', 2)} longer: {advice}."
    )
    return (text,)


def _ends_of_frequency(
    played: Sequence[SegmentSamples],
) -> tuple[tuple[float, str], tuple[float, str]]:
    """The lowest and the highest mean frequency of iterations, each with its segment."""
    frequencies = [
        (sample.interference.frequency_hz, sample.segment.id)
        for sample in played
        if sample.interference is not None and sample.interference.frequency_hz
    ] or [(1.0, "")]
    frequency = itemgetter(0)
    return min(frequencies, key=frequency), max(frequencies, key=frequency)


def _few_bursts(one: RequirementVerdict) -> tuple[str, ...]:
    """That the run met some bursts, but too few to know how long they get."""
    test = one.share
    if (
        test is None
        or not _depends_on_bursts(one)
        or test.over <= 1
        or test.burst_tolerance is None
    ):
        return ()
    counted, independent = _counted(one), test.over * test.effective_n / test.n
    some = "one burst" if test.bursts == 1 else f"{show(test.bursts, 'count')} bursts"
    seen = (
        f"The run met {some} of {counted} beyond the limit"
        if test.bursts < FEW_BURSTS
        else f"{show(test.over, 'count')} {counted} beyond the limit are as good as "
        f"{show(independent, '', 2)} independent ones"
    )
    text = (
        f"{seen}: too few to know how long bursts get. The PASS allows for a mean length of up to "
        f"{show(test.burst_tolerance, '', 2)}."
    )
    return (text,)


def _depends_on_bursts(one: RequirementVerdict) -> bool:
    """Whether longer bursts, which the run does not rule out, would change a PASS.

    The mean length of b bursts, in messages, scatters like that of exponential lengths: at 95 %
    confidence the true one is at most 2 b / chi2 of it, with chi2 of 2 b degrees of freedom. One
    bad message is no burst, and shows no more than none does.
    """
    test = one.share
    if one.outcome != "pass" or test is None or test.burst_tolerance is None:
        return False
    if test.burst_tolerance >= LONG_BURST or test.over <= 1:
        return test.burst_tolerance < LONG_BURST
    if test.bursts < FEW_BURSTS:
        return test.burst_tolerance < _LONGER_BY[test.bursts] * test.over / test.bursts
    independent = test.over * test.effective_n / test.n
    return independent < FEW_BURSTS and test.clustering in {"bursts", "clusters"}


def _counted(one: RequirementVerdict) -> str:
    return METHODS[one.method].counts


_FEW_INDEPENDENT: Final = 2.0
_MIN_CORRELATED: Final = 10
"""Fewer starts or iterations look correlated in a third of all runs in which they are not."""

PLAUSIBLE_STALL_S: Final = 0.6
"""Stops of up to this length are usual on a shared machine."""

_MAX_LONGER: Final = 100
"""Runs more than this many times longer are not proposed."""

_ALIKE: Final = 0.85
"""Starts whose deviation is below this part of that of their messages lose alike, nearly enough."""

_SAME: Final = 0.025
"""Starts that differ by a smaller share of their latency are not told apart."""

_MAX_PROPOSED_STARTS: Final = 100


def share_notes(case: RequirementCase, outcome: Outcome) -> tuple[str, ...]:
    """That a percentile or a share was decided by a single iteration."""
    if outcome == "inconclusive" or len(case.iterations) > 1:
        return ()
    return ("One iteration does not show by how much iterations differ.",)


def correlation_notes(pieces: str, number: int, inflation: float) -> tuple[str, ...]:
    """That iterations or starts resemble each other by more than a test can take account of.

    Args:
        pieces: what they are.
        number: how many.
        inflation: their F (`r2bspec.judge.statistics.autocorrelation`).
    """
    left = number / inflation
    if left >= _FEW_INDEPENDENT or number < _MIN_CORRELATED:
        return ()
    note = (
        f"Successive {pieces} may resemble each other: {number} carry the information of about "
        f"{left:.1f} independent ones, too few for a test to be sure of its confidence."
    )
    return (note,)


def uneven_start_notes(case: RequirementCase, outcome: Outcome) -> tuple[str, ...]:
    """That lost outputs do not show whether starts lose alike, where they are not as fast.

    Few starts show the deviation of their latencies roughly, and few lost outputs show nothing of
    what each start loses. So it is said where the upper bound of that deviation is nearly
    as large as that of messages (docs/proofs/verdicts.md has how often).
    """
    seen, starts = case.monitor_samples, starts_of(case.iterations)
    number = len(set(starts))
    if outcome != "pass" or not case.is_upper_bound or number < 2:
        return ()
    groups = by_start([sample.times["latency"] for sample in seen], starts)
    latencies = [np.concatenate(group) for group in groups]
    if not all(values.size for values in latencies):
        return ()
    middles = [float(np.median(values)) for values in latencies]
    scatter = deviation_within(latencies, middles)
    differ = statistics.stdev(middles)
    most = deviation_bound(differ, number, CONFIDENCE)
    if most <= _ALIKE * scatter or differ < _SAME * statistics.fmean(middles):
        return ()
    lost = sum(sample.missed for sample in seen)
    outputs = {0: "that none was lost does", 1: "one lost output does"}.get(lost, f"{lost} lost do")
    enough = (
        f"About {more} starts"
        for more in range(number + 1, _MAX_PROPOSED_STARTS + 1)
        if deviation_bound(differ, more, CONFIDENCE) <= _ALIKE * scatter
    )
    note = (
        f"The {number} starts differ by {show(differ, 's', 2)} in latency (standard "
        f"deviation, up to {show(most, 's', 2)} at {show(CONFIDENCE, 'share')} confidence; their "
        f"messages by {show(scatter, 's', 2)}), and {outputs} not show whether slower ones lose "
        f"more. {next(enough, 'More starts')} would show it."
    )
    return (note,)


def stall_notes(
    case: RequirementCase, lower: float, upper: float, outcome: Outcome
) -> tuple[str, ...]:
    """That a mean latency or a throughput is met by less than stalls that the run may have missed.

    In a run of T seconds that met no stall, there may be one every T / 3 (rule of three). Messages
    that come during stalls of S seconds wait for half of them on average, or are lost. So the mean
    latency may be larger by 3 S^2 / (2 T), and the throughput smaller by the share 3 S / T. It is
    said where stalls that would break the limit are no longer than `PLAUSIBLE_STALL_S`, and fewer
    than five were met that are half as long: from five on, the scatter of iterations shows them.

    Args:
        case: with a limit.
        lower: the bound on the true mean.
        upper: likewise.
        outcome: by these.
    """
    of_latency = case.info.family in LOSS_SENSITIVE_FAMILIES
    if outcome != "pass" or case.monitor is None or case.is_upper_bound != of_latency:
        return ()
    played_s = sum(iteration.segment.length_s for iteration in case.iterations)
    if of_latency:
        margin = max(case.limit - upper, 1e-6)
        stall_s = math.sqrt(2 * margin * played_s / 3)
        enough_s = 3 * PLAUSIBLE_STALL_S**2 / (2 * margin)
    elif case.info.family == "throughput" and lower > 0:
        margin = max((lower - case.limit) / lower, 1e-6)
        stall_s = margin * played_s / 3
        enough_s = 3 * PLAUSIBLE_STALL_S / margin
    else:
        return ()
    met = _stalls(case.monitor_samples, case.info.family, stall_s / 2)
    if stall_s > PLAUSIBLE_STALL_S or met >= FEW_BURSTS:
        return ()
    number = {0: "no stall", 1: "one stall"}.get(met, f"{met} stalls")
    every = f"Stalls of {show(stall_s, 's')} every {show(played_s / 3, 's')}"
    ways = [f"play {show(enough_s, 's')}"] if enough_s <= _MAX_LONGER * played_s else []
    if of_latency:
        ways.append("require a percentile")
    elif not any(sample.own_pace for sample in case.monitor_samples):
        ways.append("require a drop_rate")
    advice = f": {', or '.join(ways)}" if ways else ""
    note = (
        f"The run met {number} of {show(stall_s / 2, 's')} or longer in {show(played_s, 's')}. "
        f"{every} would break the limit, and 5 % of such runs meet none of them{advice}."
    )
    return (note,)


def _stalls(seen: Sequence[MonitorSamples], family: str, least_s: float) -> int:
    """How many times messages were late by so much, or came so much later than the one before."""
    times = [
        sample.times[family if family in LOSS_SENSITIVE_FAMILIES else "interval"] for sample in seen
    ]
    if not any(time_.size for time_ in times):
        return 0
    late_s = float(np.median(np.concatenate(times))) + least_s
    return sum(bursts(time_[np.newaxis] > late_s)[0] for time_ in times)
