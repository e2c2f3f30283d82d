"""Outputs that do not answer each input once: of a timer, of every n-th input, of any number.

Whether outputs come at a period of their own: that of a timer, whatever is played.

An output that follows the inputs has their period, and ends with them. That of a timer does
neither. It counts as such if, in one segment, or in all together where each has too few messages,

    its intervals are steady     their mean is within a quarter of their median, and at most one in
                                 ten is longer than 2.5 medians: ticks are late on a busy machine
    they are not the inputs'     the median is more than 5 % off the period of the steps
    messages are unasked for     2 or more answer nothing that was played; by order, where what
                                 comes after the inputs looks like an answer, 1

A node that is overloaded has a steady output, too, and misses inputs, but every message of it
answers an input. One that has several outputs for each input has unasked ones, but in bursts.

Where outputs follow the inputs, a ratio is proposed if nine in ten outputs keep to it, and the node
had time for the inputs between: an overloaded one may also answer every nth, later than that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.units import show

_MIN_INTERVALS = 4
MIN_UNASKED = 2
"""Messages that answer nothing; by order, 1 is enough."""

_STEADY_WITHIN = 0.25
_MAX_LATE_SHARE = 0.1
_LATE_PERIODS = 2.5
_OTHER_PERIOD = 0.05


@dataclass(frozen=True)
class PaceEvidence:
    """What a segment shows about the pace of the outputs of a monitor.

    Attributes:
        intervals_ns: between its messages, until the graph had drained.
        unasked: messages that answer nothing of the segment.
        least: how many of them are needed.
        step_ns: the period of the inputs.
    """

    intervals_ns: NDArray[np.int64]
    unasked: int
    least: int
    step_ns: float

    @property
    def is_enough(self) -> bool:
        """Whether there are enough messages to recognise a period."""
        return self.unasked >= self.least and self.intervals_ns.size >= _MIN_INTERVALS

    @property
    def period_s(self) -> float | None:
        """The period of the outputs, if it is their own and not that of the inputs; else None."""
        if not self.is_enough:
            return None
        intervals = self.intervals_ns
        period = float(np.median(intervals))
        late = float(np.mean(intervals > _LATE_PERIODS * period))
        steady = abs(float(intervals.mean()) - period) <= _STEADY_WITHIN * period
        if not period or not steady or late > _MAX_LATE_SHARE:
            return None
        differs = abs(period - self.step_ns) > _OTHER_PERIOD * self.step_ns
        return period / 1e9 if differs else None


def own_period_s(evidence: Sequence[PaceEvidence], overdue: int = 0) -> float | None:
    """Return the period over several segments: the median, if at least half of them have one.

    If no segment has enough messages, as with a slow timer, all segments are taken together.

    Args:
        evidence: the evidence of each segment.
        overdue: how many messages of all of them answer earlier segments.
    """
    periods_s = [period_s for segment in evidence if (period_s := segment.period_s) is not None]
    if periods_s:
        return float(np.median(periods_s)) if 2 * len(periods_s) >= len(evidence) else None
    if not evidence or any(segment.is_enough for segment in evidence):
        return None
    return PaceEvidence(
        np.concatenate([segment.intervals_ns for segment in evidence]),
        unasked=sum(segment.unasked for segment in evidence) - overdue,
        least=max(segment.least for segment in evidence),
        step_ns=float(np.mean([segment.step_ns for segment in evidence])),
    ).period_s


_NEAR_RATIO = 0.05


def own_pace_text(period_s: float, input_period_s: float = 0.0) -> str:
    """Return a sentence, in lower case, on what the monitor of such outputs should declare.

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


_KEEP_TO_RATIO = 0.9
_LEAST_STRIDES = 3
_ANY_NUMBER = 0.05


def fitting_match(strides: NDArray[np.float64], counts: NDArray[np.float64], delay: float) -> str:
    """Return a sentence on what a monitor should declare if outputs do not answer each input once.

    It begins in lower case; empty if one output for each input fits, or nothing is known.

    Args:
        strides: inputs from one that has an output to the next that has.
        counts: how many outputs those have that have any.
        delay: from an input to its output, usually, in periods of the inputs.
    """
    inputs = max(1, round(float(np.median(strides)))) if strides.size else 1
    outputs = round(float(np.median(counts))) if counts.size else 1
    is_even = not counts.size or float(np.mean(counts == outputs)) >= _KEEP_TO_RATIO
    # One that is lost makes a stride a multiple.
    keeps = not strides.size or float(np.mean(strides % inputs == 0)) >= _KEEP_TO_RATIO
    enough = strides.size >= _LEAST_STRIDES if inputs > 1 else counts.size >= _LEAST_STRIDES
    is_idle_between = delay < max(1, inputs - 1)
    if enough and is_even and keeps and is_idle_between and (inputs, outputs) != (1, 1):
        what = f"{outputs} outputs" if outputs > 1 else "an output"
        of = f"every {inputs} inputs" if inputs > 1 else "each input"
        sides = [f"inputs: {inputs}"] * (inputs > 1) + [f"outputs: {outputs}"] * (outputs > 1)
        ratio = f"'ratio: {{{', '.join(sides)}}}'"
        return f"its node has {what} for {of}. If it is meant to, write {ratio}."
    if float(np.mean(counts > 1) if counts.size else 0) > _ANY_NUMBER and not is_even:
        return (
            f"an input has up to {int(counts.max())} outputs, not always as many. Write 'match: "
            "any', and require latency or throughput; then no drop rate is defined."
        )
    return ""
