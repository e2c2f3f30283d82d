"""Whether a probed rate holds: a sequential test with a stated error, and a third answer.

A rate holds if the graph's backlog does not grow at it and little enough is lost. A probe is looked
at when it has been played for 1 s, 1.5 s, 2.25 s and so on, and at its end (`plan_interim_looks`).
At each look two tests are made, of which the second is made only if the first does not reject:

    does not hold   settled + t x error < (1 - precision / 10) x offered        the backlog grows
                    or the share dropped is clearly above  loss + precision / 2
    holds           the latency climbs by clearly less than  precision / 4  seconds per second,
                    and the share dropped is clearly not above  loss + precision / 2

`settled` is the rate at which the graph has done with steps, with its error by batch means
(`r2bspec.measure.completion_rate`): while a graph does not keep up, what it has done with is a
random walk of service times. The first third of the steps is left out there, because queues that
fill to where they will stay are no overload. While a graph does keep up, latencies scatter about a
level, and the slope of the line through them is known much better than the rate is
(`r2bspec.judge.statistics.trend`). `loss` is the drop rate that the spec allows, zero unless it
says so. A growth below a tenth of the precision is not told from none, and a rate that holds is
proven up to a quarter of the precision.

What neither test shows stays open: a graph whose service times vary by as much as they last needs
ten seconds and more to show at 100 Hz that it keeps up with 90 % of its capacity.

The error of a probe is divided among its looks in proportion to their times (an error-spending
function that is linear in time), so that looking often costs no honesty.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.statistics.trend import trend
from r2bspec.language.confidence import CONFIDENCE
from r2bspec.language.probe_length import (
    FIRST_LOOK_S,
    LOOKS_RATIO,
    MAX_NO_OUTPUT_S,
    MIN_LOOK_MESSAGES,
)
from r2bspec.measure.completion_rate import DeliveryEstimate, delivery
from r2bspec.measure.matching import Matching
from r2bspec.record.sample_arrays import Rows

_TRANSIENT_DIVISOR = 3
"""One of so many steps is left out at the start."""

_BATCHES = 10
_MIN_BATCHES = 3

_PROBE_ERROR_SHARE = 1 / 4
"""Of the error that a search may make in all, the part of one probe, either way: a search makes
several probes near the peak, and residuals that wander pass for scatter more often than a t
distribution says. With this part the brackets of simulated searches hold what they promise."""

_MIN_PLAYER_SHARE = 0.98
"""Below this share of the asked rate it is the player that did not keep up."""

_MIN_NAMED_SHARE = 1 / 4
"""What makes up less than this share of what is missing is not named."""


@dataclass(frozen=True)
class Criterion:
    """What a rate must meet: `precision` and `loss` are fractions of the offered rate."""

    precision: float
    loss: float = 0.0
    confidence: float = CONFIDENCE


@dataclass(frozen=True)
class ProbeJudgement:
    """Whether a rate holds, or None while that is open; and why, in words.

    `relative_half_width` is the relative half-width within which the rate of the graph is known.
    """

    holds: bool | None
    reason: str
    limited_by_player: bool = False
    relative_half_width: float = math.inf


@dataclass(frozen=True)
class InterimLook:
    """A time at which a probe is judged, and its part of the probe's error."""

    at_s: float
    share: float


@dataclass(frozen=True)
class ProbeEstimate:
    """What one monitor has seen of a probe so far.

    Attributes:
        overall: the delivery of all steps.
        steady: the delivery without the run-in.
        dropped: of the later answers that the graph has done with, whether each was passed over.
        sent_s: when what was answered was published, seconds from the first step, shape (n,).
        latency_s: how long each answer took, shape (n,).
    """

    overall: DeliveryEstimate
    steady: DeliveryEstimate
    dropped: NDArray[np.bool_]
    sent_s: NDArray[np.float64]
    latency_s: NDArray[np.float64]


def plan_interim_looks(limit_s: float) -> tuple[InterimLook, ...]:
    """When a probe that lasts at most `limit_s` seconds is judged; the last time is its end."""
    times: list[float] = []
    at_s = FIRST_LOOK_S
    # Two looks that are closer to one another than that show the same.
    while at_s * math.sqrt(LOOKS_RATIO) < limit_s:
        times.append(at_s)
        at_s *= LOOKS_RATIO
    times.append(limit_s)
    return tuple(InterimLook(each, each / sum(times)) for each in times)


def estimate_probe(
    rate_hz: float, playback: Rows, monitor: Rows, matching: Matching, now_ns: int
) -> ProbeEstimate:
    """Estimate from the samples of one monitor what there is to know about a probe.

    Args:
        rate_hz: the rate that was asked for.
        playback: rows of type `PLAYBACK_DTYPE` of the steps published so far.
        monitor: rows of type `MONITOR_DTYPE` of the messages received so far.
        matching: how these match.
        now_ns: the time at which `monitor` was read; CLOCK_MONOTONIC.
    """
    answered = matching.answered
    answers = np.flatnonzero(answered)
    done_with = int(answers[-1]) + 1 if answers.size else 0
    transient = done_with // _TRANSIENT_DIVISOR
    published_ns = playback["published_ns"]
    sent_ns = published_ns[matching.trigger_steps[answers]]
    received_ns = monitor["received_ns"][matching.first_row[answers]]
    steady = replace(
        matching,
        trigger_steps=matching.trigger_steps[transient:],
        first_row=matching.first_row[transient:],
    )
    return ProbeEstimate(
        overall=delivery(rate_hz, playback, monitor, matching, now_ns),
        steady=delivery(rate_hz, playback, monitor, steady, now_ns),
        dropped=~answered[transient:done_with],
        sent_s=(sent_ns - published_ns[:1]) / 1e9,
        latency_s=(received_ns - sent_ns) / 1e9,
    )


def judge_interim(
    estimate: ProbeEstimate, criterion: Criterion, look: InterimLook
) -> ProbeJudgement:
    """Judge a probe that is still being played, from what it has shown so far."""
    overall = estimate.overall
    if (
        look.at_s >= MAX_NO_OUTPUT_S
        and overall.published >= MIN_LOOK_MESSAGES
        and not overall.answered
    ):
        return ProbeJudgement(False, _shortfall(overall))
    if overall.answered < MIN_LOOK_MESSAGES or estimate.steady.batches < _MIN_BATCHES:
        return ProbeJudgement(None, "too early to tell")
    return _judge(estimate, criterion, look)


def judge_final(
    estimate: ProbeEstimate, criterion: Criterion, look: InterimLook, decided: bool | None
) -> ProbeJudgement:
    """Judge a probe that is over, from all its samples.

    Args:
        estimate: what was seen, after the graph has drained.
        criterion: what must be met.
        look: the last one.
        decided: what an earlier look has shown; that stands, and only the words are looked for.
    """
    judgement = _judge(estimate, criterion, look)
    if decided is not None:
        reason = "delivered as offered" if decided else _shortfall(estimate.overall)
        judgement = replace(judgement, holds=decided, reason=reason)
    overall = estimate.overall
    if judgement.holds is not False and overall.player_hz < _MIN_PLAYER_SHARE * overall.offered_hz:
        reason = f"the player reached only {overall.player_hz:.4g} Hz"
        return replace(judgement, holds=False, reason=reason, limited_by_player=True)
    return judgement


def worst_judgement(judgements: Sequence[ProbeJudgement]) -> ProbeJudgement:
    """Of several monitors: one that does not hold decides, then one that is open."""
    order = {False: 0, None: 1, True: 2}
    nothing = ProbeJudgement(None, "nothing was published yet")
    return min(judgements, key=lambda each: order[each.holds], default=nothing)


def _judge(estimate: ProbeEstimate, criterion: Criterion, look: InterimLook) -> ProbeJudgement:
    error = (1 - criterion.confidence) * _PROBE_ERROR_SHARE * look.share
    steady = estimate.steady
    offered_hz = min(steady.offered_hz, steady.player_hz)
    lossy = criterion.loss + criterion.precision / 2
    half_hz = _t_quantile(steady.batches, error) * steady.completed_error_hz
    relative_half_width = half_hz / offered_hz
    if steady.completed_hz + half_hz < (1 - criterion.precision / 10) * offered_hz or (
        _min_drop_share(estimate, offered_hz, error) > lossy
    ):
        return ProbeJudgement(
            False, _shortfall(estimate.overall), relative_half_width=relative_half_width
        )
    climbs = trend(estimate.sent_s, estimate.latency_s, 1 - error).upper
    if (
        climbs <= criterion.precision / 4
        and steady.completed_hz >= (1 - criterion.precision / 2) * offered_hz
        and _share_bounds(estimate.dropped, error)[1] <= lossy
    ):
        return ProbeJudgement(True, "delivered as offered", relative_half_width=relative_half_width)
    growth_hz = offered_hz - steady.completed_hz
    return ProbeJudgement(
        None,
        f"not clear: the backlog grows by {growth_hz - half_hz:.3g} to "
        f"{growth_hz + half_hz:.3g} messages/s",
        relative_half_width=relative_half_width,
    )


def _min_drop_share(estimate: ProbeEstimate, offered_hz: float, error: float) -> float:
    """The lower bound of the share dropped: by shares of batches, or by the rate of answers.

    The rate knows more where every so many messages one is dropped, the shares where drops are
    random.
    """
    steady = estimate.steady
    delivered_hz = (
        steady.delivered_hz + _t_quantile(steady.batches, error) * steady.standard_error_hz
        if estimate.dropped.any()
        else math.inf
    )
    return max(1 - delivered_hz / offered_hz, _share_bounds(estimate.dropped, error)[0])


def _share_bounds(happened: NDArray[np.bool_], error: float) -> tuple[float, float]:
    """The share of what happened with one-sided bounds by batch means, each with this error."""
    if not happened.any():
        return 0.0, 0.0
    if happened.size < _BATCHES:
        return 0.0, 1.0
    shares = [float(each.mean()) for each in np.array_split(happened, _BATCHES)]
    half = _t_quantile(_BATCHES, error) * float(np.std(shares, ddof=1)) / math.sqrt(_BATCHES)
    share = float(happened.mean())
    return share - half, share + half


def _t_quantile(batches: int, error: float) -> float:
    """Student's t; the normal one where there are no batches, and the error is Poisson's."""
    from scipy.special import ndtri, stdtrit

    if batches < _MIN_BATCHES:
        return float(ndtri(1 - error))
    return float(stdtrit(batches - 1, 1 - error))


def _shortfall(found: DeliveryEstimate) -> str:
    """Name what is seen of messages that did not come out: they wait, or are dropped, or both."""
    if not found.answered:
        return "nothing comes out"
    growth_hz = max(found.backlog_growth_hz, 0.0)
    dropped_hz = max(found.completed_hz - found.delivered_hz, 0.0)
    words = {
        f"the backlog grows by {growth_hz:.3g} messages/s": growth_hz,
        f"{found.drop_share:.2%} are dropped": dropped_hz,
    }
    named = [
        text
        for text, size_hz in sorted(words.items(), key=lambda each: -each[1])
        if size_hz >= _MIN_NAMED_SHARE * (growth_hz + dropped_hz)
    ]
    return " and ".join(named)
