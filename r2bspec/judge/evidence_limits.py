"""What a decision on shares and means cannot know, as notes of its verdict.

A test takes account of what the run has shown. One iteration does not show by how much iterations
differ, few that resemble each other carry too little information to know by how much they do, and
a mean depends on stalls of which the run may have met none. What is true of each run is in
`r2bspec.judge.run_limits`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.decision import Question
from r2bspec.judge.run_limits import FEW_BURSTS, LONG_BURST
from r2bspec.judge.verdict import Outcome
from r2bspec.measure.times import Seconds

_FEW_INDEPENDENT: Final = 2.0
_STALL_RATIO: Final = 1.5

MAY_RESEMBLE: Final = "may resemble each other"
"""Words of a note that nearly every run of few starts has; a short report leaves it out."""


def share_notes(question: Question, outcome: Outcome) -> tuple[str, ...]:
    """The notes on a percentile or a share."""
    return () if outcome == "inconclusive" else piece_notes(question)


def piece_notes(question: Question) -> tuple[str, ...]:
    """That a single iteration was played; none with two or more."""
    if len(question.iterations) > 1:
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
    question: Question, values: Sequence[Seconds], upper: float, outcome: Outcome
) -> tuple[str, ...]:
    """That a mean latency which is small enough rests on few stalls, or on none.

    Rare stalls weigh as much in a mean as many small delays, and a run may have met none of them.
    If none was met in n messages, up to 3 / n of all messages may begin one (rule of three). With
    stalls of L messages that take twice the median, the mean may be larger by 3 L / n medians.

    Args:
        question: with an upper limit.
        values: the latencies in each iteration, in the order of the steps.
        upper: the bound on the mean, in s.
        outcome: by that.
    """
    n = sum(one.size for one in values)
    if outcome != "pass" or not question.is_upper_bound or not n:
        return ()
    typical = float(np.median(np.concatenate(list(values))))
    bursts = sum(_bursts(one > _STALL_RATIO * typical) for one in values)
    if typical <= 0 or bursts >= FEW_BURSTS:
        return ()
    if (question.limit - upper) / typical * n / 3 >= LONG_BURST:
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
