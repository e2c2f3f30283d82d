"""Whether a probed rate is sustained: a sequential test with a stated error, or undecided.

A rate is sustained if the graph's backlog does not grow at it and few enough messages are lost. A
probe is judged after 1 s, 1.5 s, 2.25 s and so on, and at its end (`plan_interim_looks`). At each
look these tests are made, the others only if the first does not reject:

    not sustained   completed + t x error < (1 - precision / 10) x offered      the backlog grows
                    or the share dropped is clearly above  loss + precision / 2
    keeps up        the latency climbs by clearly less than  precision / 4  seconds per second,
                    and the share dropped so far is at most  loss + precision / 2
    few lost        the upper bound of the share dropped is at most  loss + precision / 2
    sustained       keeps up, and few lost

`completed` is the rate at which the graph completes steps, with its error by batch means
(`r2bspec.judge.measure.delivery`): while a graph does not keep up, the completed steps are a
random walk of service times. The first third of the steps is left out there, because queues that
fill up to a constant level are no overload. While a graph does keep up, latencies scatter about a
level, and the slope of the line through them is known much better than the rate is
(`r2bspec.judge.statistics.trend`). `loss` is the drop rate that the spec allows, zero by
default: "none is lost" means that at most half the precision is. The upper bound is the larger one
of that by batch means, which knows of bursts, and that of Clopper and Pearson, which knows that a
probe of 20 messages without a drop shows no more than that at most a fifth is dropped. So a rate
that keeps up may be undecided, because too few messages were played. Short queues that drop do not
let the latency climb, however large the overload is: a graph that has dropped more so far is
undecided.

A graph may start slowly, so a look before `COLD_S` rejects only a gross overload: a graph that
completes less than a third of what is offered. It may also start fast; a rate that must be shown to
be sustained is played whole (`r2bspec.language.benchmark_defaults`).

A growth below a tenth of the precision cannot be told from none. Just above the capacity a short
probe cannot tell either, because the messages that it played may have been quick ones by chance:
the error of a probe is as stated from the precision and two standard errors of the mean service
time above the capacity on.

If neither test succeeds, the rate is undecided: a graph whose service times vary by as much as
their mean needs ten seconds and more to show at 100 Hz that it keeps up with 90 % of its capacity.

The error of a probe is divided among its looks in proportion to their times (an error-spending
function that is linear in time), so that frequent looks do not increase the error. A probe that is
played whole is sustained only by its end, which has the whole error.
"""

from __future__ import annotations

import contextlib
import importlib
import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.delivery import DeliveryEstimate, delivery
from r2bspec.judge.measure.matching import Matching
from r2bspec.judge.stationarity import CompletionTimes
from r2bspec.judge.statistics.binomial import upper_bound
from r2bspec.judge.statistics.rule_of_three import min_sample_size
from r2bspec.judge.statistics.t_interval import t_quantile
from r2bspec.judge.statistics.trend import trend
from r2bspec.language.benchmark_defaults import (
    CONFIDENCE,
    FIRST_LOOK_S,
    LOOKS_RATIO,
    MAX_NO_OUTPUT_S,
    MIN_LOOK_MESSAGES,
)
from r2bspec.record.sample_arrays import Rows


def load_scipy() -> threading.Thread:
    """Import SciPy in a thread; it has to be joined before anything is measured.

    Its first use is otherwise the first look at a probe, while it plays: the import, a third of a
    second of processor time, would take a core from the graph under test.
    """
    thread = threading.Thread(target=_import_scipy, name="import of SciPy", daemon=True)
    thread.start()
    return thread


def _import_scipy() -> None:
    # The first use says that it is missing, and how to install it.
    with contextlib.suppress(ImportError):
        importlib.import_module("scipy.special")


_TRANSIENT_DIVISOR = 3
"""One of so many steps is left out at the start."""

_BATCHES = 10
_MIN_BATCHES = 3

_PROBE_ERROR_SHARE = 1 / 4
"""Of the error that a search may make in all, the part of one probe, either way: a search makes
several probes near the peak, and residuals that wander pass for scatter more often than a t
distribution says. With this part the brackets of simulated searches keep their confidence."""

COLD_S = 5.0
"""Before this time a graph may still be cold; what it fails is not held against it."""

_GROSS_SHARE = 1 / 3
"""A graph that completes less than this share of what is offered is not only cold."""

_MIN_PLAYER_SHARE = 0.98
"""Below this share of the offered rate the player did not keep up."""

_MIN_NAMED_SHARE = 1 / 4
"""A cause of less than this share of the missing messages is not named."""


@dataclass(frozen=True)
class Criterion:
    """When a rate is sustained: `precision` and `loss` are fractions of the offered rate."""

    precision: float
    loss: float = 0.0
    confidence: float = CONFIDENCE

    @property
    def max_lost(self) -> float:
        """The share that may be lost: what the spec allows, and half the precision."""
        return self.loss + self.precision / 2

    @property
    def error(self) -> float:
        """The error of one probe, in either direction."""
        return (1 - self.confidence) * _PROBE_ERROR_SHARE

    @property
    def messages_without_loss(self) -> int:
        """The number of messages that show a small enough loss if none of them is lost."""
        count = min_sample_size(self.max_lost, 1 - self.error)
        # The first third is left out, and a message on either side does not count.
        return math.ceil((count or 0) * _TRANSIENT_DIVISOR / (_TRANSIENT_DIVISOR - 1)) + 3


@dataclass(frozen=True)
class ProbeJudgement:
    """Whether a rate is sustained, None while undecided; and the reason in words.

    Attributes:
        relative_half_width: the relative half-width within which the rate of the graph is known.
        keeps_up: whether the backlog does not grow, and no more is lost so far than may be; None
            while undecided.
        lost_at_most: the upper bound of the share of messages that are lost.
    """

    holds: bool | None
    reason: str
    limited_by_player: bool = False
    relative_half_width: float = math.inf
    keeps_up: bool | None = None
    lost_at_most: float = 1.0


@dataclass(frozen=True)
class InterimLook:
    """A time at which a probe is judged, and its part of the probe's error."""

    at_s: float
    share: float


@dataclass(frozen=True)
class ProbeEstimate:
    """The samples of a monitor during a probe so far.

    Attributes:
        overall: the delivery of all steps.
        steady: the delivery without the transient at the start.
        dropped: for each later step that the graph has completed, whether it was dropped.
        sent_s: when the input of each output was published, in s from the first step, shape (n,).
        latency_s: the latency of each output, shape (n,).
        departures: when the outputs arrived.
    """

    overall: DeliveryEstimate
    steady: DeliveryEstimate
    dropped: NDArray[np.bool_]
    sent_s: NDArray[np.float64]
    latency_s: NDArray[np.float64]
    departures: CompletionTimes


def plan_interim_looks(limit_s: float) -> tuple[InterimLook, ...]:
    """Return when a probe of at most `limit_s` seconds is judged; the last time is its end."""
    times: list[float] = []
    at_s = FIRST_LOOK_S
    # Two looks that are closer together show the same.
    while at_s * math.sqrt(LOOKS_RATIO) < limit_s:
        times.append(at_s)
        at_s *= LOOKS_RATIO
    times.append(limit_s)
    return tuple(InterimLook(time_, time_ / sum(times)) for time_ in times)


def estimate_probe(
    rate_hz: float, playback: Rows, monitor: Rows, matching: Matching, now_ns: int
) -> ProbeEstimate:
    """Estimate the rates of a probe from the samples of one monitor.

    Args:
        rate_hz: the offered rate.
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
        departures=_departures(rate_hz, published_ns, received_ns, matching.per_step),
    )


def _departures(
    rate_hz: float,
    published_ns: NDArray[np.int64],
    received_ns: NDArray[np.int64],
    per_step: float,
) -> CompletionTimes:
    """Return the outputs that arrived while inputs were published."""
    first_ns, last_ns = (
        (int(published_ns[0]), int(published_ns[-1])) if published_ns.size else (0, 0)
    )
    arrived = np.sort(received_ns[received_ns <= last_ns])
    return CompletionTimes(
        begun_s=first_ns / 1e9,
        times_s=(arrived - first_ns) / 1e9,
        played_s=(last_ns - first_ns) / 1e9,
        offered_hz=rate_hz * per_step,
        per_step=per_step,
    )


def judge_interim(
    estimate: ProbeEstimate, criterion: Criterion, look: InterimLook
) -> ProbeJudgement:
    """Judge a probe that is still being played, by its samples so far.

    A probe that is played whole goes on even if the rate seems to be sustained.
    """
    overall = estimate.overall
    if (
        look.at_s >= MAX_NO_OUTPUT_S
        and overall.published >= MIN_LOOK_MESSAGES
        and not overall.answered
    ):
        return ProbeJudgement(False, _shortfall(overall))
    if overall.answered < MIN_LOOK_MESSAGES or estimate.steady.batches < _MIN_BATCHES:
        return ProbeJudgement(None, "too few outputs so far")
    return _judge(estimate, criterion, look, cold=look.at_s < COLD_S)


def judge_final(
    estimate: ProbeEstimate,
    criterion: Criterion,
    look: InterimLook,
    decided: ProbeJudgement | None,
    *,
    whole: bool = False,
    proven_hz: float = 0.0,
) -> ProbeJudgement:
    """Judge a probe that is over, from all its samples.

    Args:
        estimate: from all samples, after the graph has drained.
        criterion: the criterion of a sustained rate.
        look: the last one.
        decided: the judgement of the look that ended the probe early, None if none did; it stays,
            and only its reason is worked out.
        whole: whether only this look could find the rate to be sustained.
        proven_hz: the rate with which other plays have shown that the graph keeps up. Then this
            one need not show it again, if its backlog does not seem to grow.
    """
    cold = decided is not None and look.at_s < COLD_S
    judgement = _judge(estimate, criterion, look, whole=whole, proven_hz=proven_hz, cold=cold)
    if decided is not None and decided.holds is not None:
        reason = "delivered as offered" if decided.holds else _shortfall(estimate.overall)
        judgement = replace(judgement, holds=decided.holds, reason=reason, keeps_up=decided.holds)
    elif decided is not None and decided.keeps_up and judgement.keeps_up is None:
        judgement = _kept_up(estimate, criterion, judgement)
    overall = estimate.overall
    if judgement.holds is not False and overall.player_hz < _MIN_PLAYER_SHARE * overall.offered_hz:
        reason = f"the player reached only {overall.player_hz:.4g} Hz"
        return replace(
            judgement, holds=False, reason=reason, limited_by_player=True, keeps_up=False
        )
    return judgement


def worst_judgement(judgements: Sequence[ProbeJudgement]) -> ProbeJudgement:
    """Return the worst judgement of several monitors.

    Not sustained is worst, then undecided, then a graph that keeps up but may lose messages.
    """
    nothing = ProbeJudgement(None, "nothing was published yet")
    worst = min(judgements, key=_rank, default=nothing)
    lost = max((judgement.lost_at_most for judgement in judgements), default=1.0)
    return replace(worst, lost_at_most=lost) if lost != worst.lost_at_most else worst


def _rank(judgement: ProbeJudgement) -> int:
    if judgement.holds is None:
        return 2 if judgement.keeps_up else 1
    return 3 if judgement.holds else 0


def _judge(
    estimate: ProbeEstimate,
    criterion: Criterion,
    look: InterimLook,
    *,
    cold: bool,
    whole: bool = False,
    proven_hz: float = 0.0,
) -> ProbeJudgement:
    error = criterion.error * look.share
    steady = estimate.steady
    offered_hz = min(steady.offered_hz, steady.player_hz)
    half_hz = _t_quantile(steady.batches, error) * steady.completed_error_hz
    # Of a whole play this is the only look that can find the rate to be sustained.
    hold_error = criterion.error if whole else error
    lost = _max_drop_share(estimate.dropped, hold_error)
    undecided = ProbeJudgement(
        None, "", relative_half_width=half_hz / offered_hz, lost_at_most=lost
    )
    if _fails(estimate, criterion, offered_hz, half_hz, error, cold=cold):
        reason = _shortfall(estimate.overall)
        return replace(undecided, holds=False, reason=reason, keeps_up=False)
    # A play that nothing ends early has time to leave out a slow start here, too.
    skip = estimate.sent_s.size // _TRANSIENT_DIVISOR if whole else 0
    climbs = trend(estimate.sent_s[skip:], estimate.latency_s[skip:], 1 - hold_error).upper
    if (climbs <= criterion.precision / 4 or steady.offered_hz <= proven_hz) and (
        steady.completed_hz >= (1 - criterion.precision / 2) * offered_hz
    ):
        if lost <= criterion.max_lost:
            return replace(undecided, holds=True, reason="delivered as offered", keeps_up=True)
        return _kept_up(estimate, criterion, undecided)
    growth_hz = offered_hz - steady.completed_hz
    reason = (
        f"the backlog grows by {growth_hz - half_hz:.3g} to {growth_hz + half_hz:.3g} messages/s"
    )
    return replace(undecided, reason=reason)


def _kept_up(
    estimate: ProbeEstimate, criterion: Criterion, judgement: ProbeJudgement
) -> ProbeJudgement:
    """Return the judgement where the backlog does not grow, but few losses are not shown."""
    number = int(estimate.dropped.size)
    seen = int(np.count_nonzero(estimate.dropped))
    loss_text = f"at most {100 * judgement.lost_at_most:.2g} % lost ({seen} of {number} messages)"
    if seen > criterion.max_lost * number:
        return replace(judgement, reason=loss_text)
    return replace(judgement, keeps_up=True, reason=f"keeps up; {loss_text}")


def _fails(
    estimate: ProbeEstimate,
    criterion: Criterion,
    offered_hz: float,
    half_hz: float,
    error: float,
    *,
    cold: bool,
) -> bool:
    """Return whether the rate is clearly not sustained, and not only because the graph is cold."""
    completed_hz = estimate.steady.completed_hz + half_hz
    dropped = _min_drop_share(estimate, offered_hz, error)
    if cold:
        return completed_hz < _GROSS_SHARE * offered_hz or dropped > 1 - _GROSS_SHARE
    return completed_hz < (1 - criterion.precision / 10) * offered_hz or (
        dropped > criterion.max_lost
    )


def _min_drop_share(estimate: ProbeEstimate, offered_hz: float, error: float) -> float:
    """Return the lower bound of the share dropped: by shares of batches, or by the rate of outputs.

    The rate is more precise if messages are dropped periodically, the shares if drops are random.
    """
    steady = estimate.steady
    delivered_hz = (
        steady.delivered_hz + _t_quantile(steady.batches, error) * steady.standard_error_hz
        if estimate.dropped.any()
        else math.inf
    )
    return max(1 - delivered_hz / offered_hz, _share_bounds(estimate.dropped, error)[0])


def _max_drop_share(dropped: NDArray[np.bool_], error: float) -> float:
    """Return the larger upper bound of the lost share: of batch means or Clopper-Pearson."""
    if not dropped.size:
        return 1.0
    exact = upper_bound(int(np.count_nonzero(dropped)), int(dropped.size), 1 - error)
    return min(1.0, max(_share_bounds(dropped, error)[1], exact))


def _share_bounds(happened: NDArray[np.bool_], error: float) -> tuple[float, float]:
    """Return the share of true flags with one-sided bounds by batch means, each with this error."""
    if not happened.any():
        return 0.0, 0.0
    if happened.size < _BATCHES:
        return 0.0, 1.0
    shares = [float(batch.mean()) for batch in np.array_split(happened, _BATCHES)]
    half = _t_quantile(_BATCHES, error) * float(np.std(shares, ddof=1)) / math.sqrt(_BATCHES)
    share = float(happened.mean())
    return share - half, share + half


def _t_quantile(batches: int, error: float) -> float:
    """Student's t; the normal one where there are no batches, and the error is Poisson's."""
    return t_quantile(batches - 1 if batches >= _MIN_BATCHES else math.inf, 1 - error)


def _shortfall(found: DeliveryEstimate) -> str:
    """Name what became of the missing messages: they wait, are dropped, or both."""
    if not found.answered:
        return "no output"
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
