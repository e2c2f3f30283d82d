"""The delivery of a graph while a rate is probed: the rate of its outputs, and its error.

A probe decides whether a graph keeps up and whether it loses messages. The first is decided by a
rate and its standard error, the second by a share; they are kept apart, because a bounded queue
turns a backlog into losses as soon as it is full.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.matching import Matching
from r2bspec.record.sample_arrays import Rows

_MAX_BATCHES = 10
"""Few, so that each is long compared with the correlation time."""
_MIN_BATCH_OUTPUTS = 4
"""Batches with fewer outputs have no meaningful slope."""


@dataclass(frozen=True)
class RateEstimate:
    """A rate of events and its standard error, both in Hz, from `batches` batches (0: too few)."""

    hz: float
    standard_error_hz: float
    batches: int

    def divided_by(self, factor: float) -> RateEstimate:
        """Return the rate of groups of this many events."""
        return RateEstimate(self.hz / factor, self.standard_error_hz / factor, self.batches)


@dataclass(frozen=True)
class DeliveryEstimate:
    """The output of the graph at one offered rate, so far.

    All rates count steps, whatever the ratio: a graph that has one output for three steps and keeps
    up has completed and delivered as many steps as were played.

    Attributes:
        offered_hz: the offered rate.
        player_hz: the published rate; below `offered_hz` the player limits.
        delivered_hz: steps with an output per second. With losses it is below `completed_hz`.
        standard_error_hz: the standard error of `delivered_hz`.
        completed_hz: steps per second that the graph has completed, delivered or dropped.
        completed_error_hz: the standard error of `completed_hz`.
        batches: the batches behind both standard errors; batches - 1 is the number of degrees
            of freedom. 0 if there were too few outputs for batches.
        drop_share: the share of the completed outputs that never arrived.
        published: steps published.
        answered: outputs received.
    """

    offered_hz: float
    player_hz: float
    delivered_hz: float
    standard_error_hz: float
    completed_hz: float
    completed_error_hz: float
    batches: int
    drop_share: float
    published: int
    answered: int

    @property
    def backlog_growth_hz(self) -> float:
        """Steps per second by which the queue inside the graph grows: published - completed.

        Its standard error is `completed_error_hz`, because that of the player is negligible. Losses
        do not count here: a graph that drops every tenth message at once has no backlog.
        """
        return self.player_hz - self.completed_hz


def delivery(
    offered_hz: float, playback: Rows, monitor: Rows, match: Matching, now_ns: int
) -> DeliveryEstimate:
    """Estimate what a graph delivers, from what a monitor received so far.

    Let t_i be when the i-th first output was received, s_i its step, and r the expected outputs per
    step, usually 1. The rates are the reciprocal slopes of two least-squares lines:

        t = a + i / (r delivered_hz)        t = a + s / completed_hz

    While the graph keeps up, latency only scatters t about the second line, whose slope is the
    period of the playback. When it does not, each output waits longer than the one before and
    the line is steeper. If a published step stays without output for longer than any output took,
    the rates are at most

        answered / (r (now - t_first))      (1 + last step - first step) / (now - t_first)

    Works from the first sample on: without outputs the rates are 0 with a standard error of one
    message in the time waited.

    Args:
        offered_hz: the offered rate.
        playback: rows of type `PLAYBACK_DTYPE` of the steps published so far.
        monitor: rows of type `MONITOR_DTYPE` of the messages received so far.
        match: how these match.
        now_ns: the time at which `monitor` was read; CLOCK_MONOTONIC.
    """
    published = playback["published_ns"]
    answers = np.flatnonzero(match.answered)
    arrived = monitor["received_ns"][match.first_row[answers]]
    order = np.argsort(arrived, kind="stable")
    arrived, answers = arrived[order], answers[order]
    until = _stall_span(published[match.trigger_steps], arrived, answers, now_ns)
    delivered = _event_rate(arrived, np.arange(answers.size), until).divided_by(match.per_step)
    completed = _event_rate(arrived, match.trigger_steps[answers], until)
    passed = int(answers.max()) + 1 if answers.size else 0
    return DeliveryEstimate(
        offered_hz=offered_hz,
        player_hz=_player_rate(published, offered_hz),
        delivered_hz=delivered.hz,
        standard_error_hz=delivered.standard_error_hz,
        completed_hz=completed.hz,
        completed_error_hz=completed.standard_error_hz,
        batches=completed.batches,
        drop_share=(passed - answers.size) / passed if passed else 0.0,
        published=int(playback.size),
        answered=int(answers.size),
    )


def _player_rate(published: NDArray[np.int64], offered_hz: float) -> float:
    """Return the slope of the publication times; the offered rate while there is only one."""
    if published.size < 2:
        return offered_hz
    return 1.0 / _least_squares(published, np.arange(published.size))


def _stall_span(
    published: NDArray[np.int64],
    arrived: NDArray[np.int64],
    answers: NDArray[np.int64],
    now_ns: int,
) -> tuple[int, int] | None:
    """Return the span (from, to) that counts if the output has stopped, or None if it has not.

    The output has stopped if the next one is overdue by longer than any output took, and the time
    since the last one is longer than any gap between two. It is not counted past the moment at
    which the last expected one would be that late, so that the time after playing does not count.

    Args:
        published: when the step of each expected output was published.
        arrived: when the outputs were received, ascending.
        answers: which of the expected ones these are.
        now_ns: until when nothing else has arrived.
    """
    if not published.size:
        return None
    if not answers.size:
        return int(published[0]), now_ns
    latest = int(answers.max())
    if latest >= published.size - 1:
        return None
    longest = int(np.max(arrived - published[answers]))
    to = min(now_ns, int(published[-1]) + longest)
    pause = int(np.max(np.diff(arrived))) if arrived.size > 1 else 0
    waiting = to - int(published[latest + 1])
    if waiting <= longest or to - int(arrived[-1]) <= pause:
        return None
    return int(arrived[0]), to


def _event_rate(
    arrived: NDArray[np.int64], index: NDArray[np.int64], stalled: tuple[int, int] | None
) -> RateEstimate:
    """Return the rate at which `index` advances, bounded by a gap at the end."""
    slope = _slope(arrived, index) if arrived.size > 1 else None
    if stalled is None:
        return slope or RateEstimate(0.0, math.inf, 0)
    waited_s = max(stalled[1] - stalled[0], 1) / 1e9
    count = int(index.max() - index.min()) + 1 if index.size else 0
    bound_hz = count / waited_s
    if slope is None:
        return RateEstimate(bound_hz, 1 / waited_s, 0)
    if bound_hz >= slope.hz:
        return slope
    error = slope.standard_error_hz if slope.batches else bound_hz / math.sqrt(index.size)
    return RateEstimate(bound_hz, max(error, 1 / waited_s), slope.batches)


def _slope(arrived: NDArray[np.int64], index: NDArray[np.int64]) -> RateEstimate:
    """Return the reciprocal least-squares slope, with a standard error by batch means.

    The residuals of the line are correlated: they are the latencies of neighbours while the
    graph keeps up, and a random walk of service times while it does not. The textbook error of
    a slope would be far too small, so the outputs are cut into b batches of successive ones,
    each gets a line of its own, and with the standard deviation S of the b slopes

        standard error of the slope = S / sqrt(b)

    which is right for the random walk and too large, hence safe, for scatter about a line. By
    the delta method the rate 1 / slope has the standard error  rate^2 x that of the slope.
    With too few outputs for three batches they are treated as a Poisson process:
    standard error = rate / sqrt(n - 1).
    """
    rate = 1.0 / _least_squares(arrived, index)
    batches = min(_MAX_BATCHES, arrived.size // _MIN_BATCH_OUTPUTS)
    if batches < 3:
        return RateEstimate(rate, rate / math.sqrt(arrived.size - 1), 0)
    slopes = _batch_slopes(arrived, index, batches)
    error = float(np.std(slopes, ddof=1)) / math.sqrt(batches)
    return RateEstimate(rate, rate * rate * error, batches)


def _least_squares(times_ns: NDArray[np.int64], index: NDArray[np.int64]) -> float:
    """Return the slope, in seconds per step, of the least-squares line of times on indices.

        slope = sum (i - mean i)(t - mean t) / sum (i - mean i)^2

    The times are taken from the first one on while they are still whole nanoseconds: as
    floating-point numbers since boot they would lose the last digits. A slope of zero or less
    (two outputs at one instant) becomes one nanosecond, the resolution of the clock.
    """
    return float(_batch_slopes(times_ns, index, 1)[0])


def _batch_slopes(
    times_ns: NDArray[np.int64], index: NDArray[np.int64], batches: int
) -> NDArray[np.float64]:
    """Return the slope of each of so many batches of successive events (`_least_squares`).

    They are as long as each other, or longer by one, the longer ones first. All are calculated at
    once, because a search looks at its rates all the time.
    """
    shortest, longer = divmod(times_ns.size, batches)
    sizes = np.full(batches, shortest)
    sizes[:longer] += 1
    starts = np.cumsum(sizes) - sizes

    def centred(values: NDArray[np.int64]) -> NDArray[np.float64]:
        shifted = values - np.repeat(values[starts], sizes)
        exact: NDArray[np.float64] = shifted.astype(np.float64)
        exact -= np.repeat(np.add.reduceat(exact, starts) / sizes, sizes)
        return exact

    i, t = centred(index), centred(times_ns) / 1e9
    spread = np.add.reduceat(i * i, starts)
    together = np.add.reduceat(i * t, starts)
    slopes = np.divide(together, spread, out=np.zeros(batches), where=spread > 0)
    return np.maximum(slopes, 1e-9, out=slopes)
