"""What no test can tell from a run, in words.

A test takes account of what the run has shown. A run is one stretch of time on one machine. It has
met some kinds of starts, of which rare ones are not among few starts; it has met so many bursts of
bad messages, and from few the longest cannot be known; and few starts hardly show whether each
resembles the one before. These facts are the same for each run, so they are stated once, and at
a requirement only what is particular to it.

Of a single decision on shares and means, notes say what it cannot know: one iteration does not show
by how much iterations differ, few that resemble each other carry too little information to know by
how much they do, and a mean depends on stalls of which the run may have met none.
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.measure.times import Seconds
from r2bspec.judge.measure.units import show
from r2bspec.judge.methods import METHODS
from r2bspec.judge.statistics.rule_of_three import zero_failure_bound
from r2bspec.judge.verdict import Outcome, RequirementVerdict
from r2bspec.language.benchmark_defaults import CONFIDENCE

if TYPE_CHECKING:
    from r2bspec.judge.requirement_case import RequirementCase

_PROBES: Final = ("probe", "sustained")
"""Segments of probes. In a comparison in pairs, each run has its own."""

FEW_BURSTS: Final = 5
LONG_BURST: Final = 20.0
"""Messages; a PASS that allows for bursts of this mean length needs no note on them."""

MANY_PIECES: Final = 20
"""So many starts, or iterations of a single start, show whether each resembles the one before."""

FIRST_START_ALONE: Final = "Probed in the first start of the processes alone."
WITHOUT_BURST: Final = "passed without a burst beyond"
"""Words of what is true of most runs of a kind; a short report leaves such sentences out."""


def particular_caveats(limits: Sequence[str]) -> Sequence[str]:
    """The limits of a verdict without the first, which every run has alike (`run_caveats`)."""
    return limits[1:]


def run_caveats(requirements: Sequence[RequirementVerdict], samples: RunSamples) -> tuple[str, ...]:
    """What the run as a whole cannot show, a sentence each; nothing without requirements.

    Args:
        requirements: the verdicts on them.
        samples: the run.
    """
    if not requirements:
        return ()
    decided = any(
        one.outcome != "inconclusive" and one.method not in {"none", "observation"}
        for one in requirements
    )
    return (_one_stretch(samples, decided=decided), *_no_burst(requirements))


def with_caveats(
    requirements: Sequence[RequirementVerdict], samples: RunSamples
) -> tuple[RequirementVerdict, ...]:
    """The verdicts on requirements, with what each of them cannot know.

    Args:
        requirements: the final verdicts on them.
        samples: the run.
    """
    probed = {each.start for each in samples.record.segments if each.kind in _PROBES}
    first_alone = samples.starts > 1 and probed <= {1}
    return tuple(
        one.noted(*_few_bursts(one), *_probed_start(one, first_alone=first_alone))
        for one in requirements
    )


def _one_stretch(samples: RunSamples, *, decided: bool) -> str:
    starts = samples.starts
    kind = "starts" if starts > 1 else "iterations"
    number = f"{starts} starts" if starts > 1 else "one start"
    fact = f"{_when_and_where(samples)}, in {number}"
    if not decided:
        return f"{fact}."
    played = min(map(len, samples.iterations.values()), default=1)
    unseen = f"{_unseen(starts)} of starts and {_unseen(played)} of iterations"
    doubts = ["another hour may differ", f"up to {unseen} may be of a kind not met"]
    pieces = starts if starts > 1 else played
    if 1 < pieces < MANY_PIECES:
        doubts.append(f"{pieces} {kind} hardly show whether each resembles the one before")
    return f"{fact}: {', '.join(doubts[:-1])}, and {doubts[-1]}."


def _unseen(number: int) -> str:
    """The largest share of starts or iterations of a kind that is not among so many."""
    return show(zero_failure_bound(number, CONFIDENCE), "share", 2)


def _when_and_where(samples: RunSamples) -> str:
    """Such as ``Played between 10:02 and 10:04 UTC on 2026-01-31, on PROCESSOR``."""
    record = samples.record
    where = str(record.machine.get("cpu") or record.machine.get("architecture") or "")
    on = f" on {where}" if where else ""
    try:
        began, ended = (
            datetime.datetime.fromisoformat(each).astimezone(datetime.UTC)
            for each in (record.started_at, record.ended_at)
        )
    except ValueError:
        return f"Played{on} in one stretch of time"
    day = "" if began.date() == ended.date() else f"{ended:%Y-%m-%d} "
    return f"Played{on} between {began:%Y-%m-%d %H:%M} and {day}{ended:%H:%M} UTC"


def _no_burst(requirements: Sequence[RequirementVerdict]) -> tuple[str, ...]:
    """That passes met no burst beyond their limits, once for all of them."""
    found = [
        (one.share.burst_tolerance, one)
        for one in requirements
        if one.share is not None
        and _depends_on_bursts(one)
        and not one.share.over
        and one.share.burst_tolerance is not None
    ]
    if not found:
        return ()
    shortest, one = min(found, key=lambda each: each[0])
    allowed = f"bursts of up to {show(shortest, '', 2)} {_counted(one)} on average"
    if len(found) == 1:
        text = f"{one.text.strip()} {WITHOUT_BURST} the limit; it allows {allowed}."
        return (text,)
    text = (
        f"{len(found)} requirements {WITHOUT_BURST} their limits; "
        f"{one.text.strip()} allows the shortest, {allowed}."
    )
    return (text,)


def _few_bursts(one: RequirementVerdict) -> tuple[str, ...]:
    """That the run met some bursts, but too few to know how long they get."""
    test = one.share
    if test is None or not _depends_on_bursts(one) or not test.over or test.burst_tolerance is None:
        return ()
    counted, independent = _counted(one), test.over * test.effective_n / test.n
    bursts = "one burst" if test.bursts == 1 else f"{show(test.bursts, 'count')} bursts"
    seen = (
        f"The run met {bursts} of {counted} beyond the limit"
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
    """Whether longer bursts than it may have met would change a PASS."""
    test = one.share
    if one.outcome != "pass" or test is None or test.burst_tolerance is None:
        return False
    independent = test.over * test.effective_n / test.n
    return min(test.bursts, independent) < FEW_BURSTS and test.burst_tolerance < LONG_BURST


def _counted(one: RequirementVerdict) -> str:
    return METHODS[one.method].counts


def _probed_start(one: RequirementVerdict, *, first_alone: bool) -> tuple[str, ...]:
    """That a requirement rests on probes that were made in the first start alone."""
    if not first_alone or METHODS[one.method].rests_on == "iterations":
        return ()
    return (FIRST_START_ALONE,)


_FEW_INDEPENDENT: Final = 2.0
_STALL_RATIO: Final = 1.5

MAY_RESEMBLE: Final = "may resemble each other"
"""Words of a note that nearly every run of few starts has; a short report leaves it out."""


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
    if left >= _FEW_INDEPENDENT:
        return ()
    note = (
        f"Successive {pieces} {MAY_RESEMBLE}: {number} carry the information of about "
        f"{left:.1f} independent ones, too few for a test to be sure of its confidence."
    )
    return (note,)


def stall_notes(
    case: RequirementCase, values: Sequence[Seconds], upper: float, outcome: Outcome
) -> tuple[str, ...]:
    """That a mean latency which is small enough rests on few stalls, or on none.

    Rare stalls weigh as much in a mean as many small delays, and a run may have met none of them.
    If none was met in n messages, up to 3 / n of all messages may begin one (rule of three). With
    stalls of L messages that take twice the median, the mean may be larger by 3 L / n medians.

    Args:
        case: with an upper limit.
        values: the latencies in each iteration, in the order of the steps.
        upper: the bound on the mean, in s.
        outcome: by that.
    """
    n = sum(one.size for one in values)
    if outcome != "pass" or not case.is_upper_bound or not n:
        return ()
    typical = float(np.median(np.concatenate(list(values))))
    bursts = sum(_bursts(one > _STALL_RATIO * typical) for one in values)
    if typical <= 0 or bursts >= FEW_BURSTS:
        return ()
    if (case.limit - upper) / typical * n / 3 >= LONG_BURST:
        return ()
    met = {0: "no stall", 1: "one stall"}.get(bursts, f"{bursts} stalls")
    note = (
        f"The run met {met} (over {_STALL_RATIO:g} times the median), too few to know how often "
        "and for how long they come, and the mean depends on that. A percentile does not."
    )
    return (note,)


def _bursts(flags: NDArray[np.bool_]) -> int:
    """Runs of True."""
    return int(np.count_nonzero(flags[1:] & ~flags[:-1])) + int(flags[:1].sum())
