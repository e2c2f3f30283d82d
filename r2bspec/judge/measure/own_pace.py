"""Whether an output comes at a period of its own: that of a timer, whatever is played.

An output that follows the inputs has their period, and ends with them. That of a timer does
neither. It counts as such if, in one segment,

    its intervals are steady     their mean is within a quarter of their median, and at most one in
                                 ten is longer than 2.5 medians: ticks are late on a busy machine
    they are not the inputs'     the median is more than 5 % off the period of the steps
    messages are unasked for     2 or more answer nothing that was played; by order, where what
                                 comes after the inputs looks like an answer, 1

A node that is overloaded has a steady output, too, and misses inputs, but every message of it
answers an input. One that has several outputs for each input has unasked ones, but in bursts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from r2bspec.judge.measure.matching import NO_MATCH, MatchedMonitor
from r2bspec.judge.measure.units import show
from r2bspec.record.run_record import Segment

_MIN_INTERVALS = 4
_MIN_UNASKED = 2
_STEADY_WITHIN = 0.25
_MAX_LATE_SHARE = 0.1
_LATE_PERIODS = 2.5
_OTHER_PERIOD = 0.05


def own_period_s(segment: Segment, matched: MatchedMonitor) -> float | None:
    """The period of a monitor's outputs, if it is their own and not that of the inputs; else None.

    Args:
        segment: in which inputs were played.
        matched: what the monitor received in it, until the graph had drained.
    """
    rows, matching = matched.rows, matched.matching
    answering = matching.first_row[matching.first_row != NO_MATCH]
    least = 1 if matching.by_order else _MIN_UNASKED
    if matched.own_pace or rows.size - answering.size < least or not matched.steps.size:
        return None
    intervals = np.diff(np.sort(rows["received_ns"]))
    if intervals.size < _MIN_INTERVALS:
        return None
    period = float(np.median(intervals))
    played = (segment.ended_ns - segment.began_ns) / matched.steps.size
    late = float(np.mean(intervals > _LATE_PERIODS * period))
    steady = (
        late <= _MAX_LATE_SHARE and abs(float(intervals.mean()) - period) <= _STEADY_WITHIN * period
    )
    return period / 1e9 if period and steady and abs(period / played - 1) > _OTHER_PERIOD else None


def pooled_period_s(periods_s: Sequence[float | None]) -> float | None:
    """The period over several segments: the median, if at least half of them have one."""
    known = [period_s for period_s in periods_s if period_s is not None]
    return float(np.median(known)) if known and 2 * len(known) >= len(periods_s) else None


_NEAR_RATIO = 0.05


def own_pace_text(period_s: float, input_period_s: float = 0.0) -> str:
    """What a monitor of such outputs should say, as a sentence that begins in lower case.

    Args:
        period_s: of the outputs.
        input_period_s: of the inputs, if outputs have stamps of inputs and there is one rate; for
            a ratio, which holds at one rate only. 0 proposes none.
    """
    ratio = ""
    if input_period_s:
        for name, per in (
            ("inputs", period_s / input_period_s),
            ("outputs", input_period_s / period_s),
        ):
            if round(per) > 1 and abs(per / round(per) - 1) <= _NEAR_RATIO:
                ratio = f", or, at this rate alone, 'ratio: {{{name}: {round(per)}}}'"
    return (
        f"its node publishes every {show(period_s, 's')}, whatever is played. Write 'match: "
        f"own_pace', and require throughput, age, interval or jitter{ratio}."
    )
