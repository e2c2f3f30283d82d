"""Whether a probed rate holds: decided as early as the samples allow.

A rate holds if the graph answers what it is offered and its backlog does not grow. Both are rates
of what comes out (`r2bspec.measure.delivery`), and both are tested:

    settled_hz   >= (1 - precision/2) x offered            the backlog does not grow
    delivered_hz >= (1 - precision/2 - loss) x offered     little enough is lost

where `loss` is the drop rate that the spec allows a rate that holds, zero unless it says so. A
backlog that grows by less is within the precision of the search; one that grows by more is found
however deep the queues are, because it is the slope that is tested and not the queue.

A probe is stopped as soon as each rate is clear of its limit by `_CLEAR` standard errors, on
either side, but not before `_LEAST_S` seconds and `_LEAST_MESSAGES` messages; at the end of the
probe the estimates themselves decide.
"""

from __future__ import annotations

from dataclasses import dataclass

from r2bspec.measure.delivery import Delivery

_CLEAR = 4.0
"""Standard errors. The test is made several times in a probe, and ten batches leave nine degrees
of freedom, so this is about one wrong stop in a few hundred probes and not in ten thousand."""

_LEAST_S = 1.0
_LEAST_MESSAGES = 30

_PLAYER_SHARE = 0.98
"""Below this share of the asked rate it is the player that did not keep up."""


@dataclass(frozen=True)
class Judgement:
    """Whether a rate holds, or None while that is open; and why, in words."""

    holds: bool | None
    reason: str
    by_player: bool = False


@dataclass(frozen=True)
class Criterion:
    """What a rate must meet: both are fractions of the offered rate."""

    precision: float
    loss: float = 0.0


def judge_probe(delivery: Delivery, criterion: Criterion, elapsed_s: float) -> Judgement:
    """Judge a probe that is still being played, from what it has shown so far.

    Args:
        delivery: the estimate from all samples so far.
        criterion: what must be met.
        elapsed_s: how long the probe has been played, in seconds.
    """
    if elapsed_s < _LEAST_S or delivery.published < _LEAST_MESSAGES or not delivery.batches:
        return Judgement(None, "too early to tell")
    return _compare(delivery, criterion, _CLEAR)


def judge_finished_probe(delivery: Delivery, criterion: Criterion) -> Judgement:
    """Judge a probe that has been played to its end, or was stopped because the answer was clear.

    Args:
        delivery: the estimate from all samples.
        criterion: what must be met.
    """
    if delivery.player_hz < _PLAYER_SHARE * delivery.offered_hz:
        return Judgement(
            holds=False,
            reason=f"the player reached only {delivery.player_hz:.4g} Hz",
            by_player=True,
        )
    return _compare(delivery, criterion, 0.0)


def _compare(delivery: Delivery, criterion: Criterion, clear: float) -> Judgement:
    """Compare both rates with their limits, keeping `clear` standard errors away from them."""
    offered_hz = min(delivery.offered_hz, delivery.player_hz)
    settled_limit_hz = (1 - criterion.precision / 2) * offered_hz
    delivered_limit_hz = settled_limit_hz - criterion.loss * offered_hz
    settled_margin_hz = clear * delivery.settled_error_hz
    delivered_margin_hz = clear * delivery.standard_error_hz
    if delivery.settled_hz + settled_margin_hz < settled_limit_hz:
        growth_hz = max(delivery.backlog_growth_hz, 0.0)
        return Judgement(holds=False, reason=f"the backlog grows by {growth_hz:.3g} messages/s")
    if delivery.delivered_hz + delivered_margin_hz < delivered_limit_hz:
        return Judgement(holds=False, reason=f"{delivery.drop_share:.2%} are dropped")
    if (
        delivery.settled_hz - settled_margin_hz >= settled_limit_hz
        and delivery.delivered_hz - delivered_margin_hz >= delivered_limit_hz
    ):
        return Judgement(holds=True, reason="delivered as offered")
    return Judgement(None, "not clear yet")
