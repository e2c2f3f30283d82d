"""Whether a probed rate holds: decided as early as the samples allow.

A rate holds if the graph delivers what it is offered and its backlog does not grow. Both show in
the slope of what comes out (`r2bspec.measure.delivery`): the rate holds while the settled rate is
at least (1 - precision/2) of the offered one. A backlog that grows by less than that is within the
precision of the search; one that grows by more is found however deep the queues are, because it is
the slope that is tested and not the queue.

A probe is stopped as soon as the slope is clear of the limit by `_CLEAR` standard errors on either
side, but not before `_LEAST_S` seconds and `_LEAST_MESSAGES` messages; at its end the estimate
itself decides.
"""

from __future__ import annotations

from dataclasses import dataclass

from r2bspec.measure.delivery import Delivery

_CLEAR = 4.0
"""Standard errors. The test is made several times in a probe, and ten batches leave nine degrees
of freedom, so this is not 4 sigma but about one wrong stop in a few hundred probes."""

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


def judge_probe(
    delivery: Delivery, precision: float, elapsed_s: float, *, final: bool, closed_early: bool
) -> Judgement:
    """Judge what a probe has shown so far.

    Args:
        delivery: the estimate from all samples so far.
        precision: the relative precision of the search, as a fraction.
        elapsed_s: how long the probe has played, in seconds.
        final: True at the end of the probe, when a decision must be made.
        closed_early: True where the end was chosen because the answer was clear.
    """
    offered_hz = delivery.offered_hz
    if final and not closed_early and delivery.player_hz < _PLAYER_SHARE * offered_hz:
        return Judgement(
            holds=False,
            reason=f"the player reached only {delivery.player_hz:.4g} Hz",
            by_player=True,
        )
    limit_hz = (1 - precision / 2) * min(offered_hz, delivery.player_hz)
    settled_hz, error_hz = delivery.settled_hz, delivery.settled_error_hz
    early = elapsed_s >= _LEAST_S and delivery.published >= _LEAST_MESSAGES and delivery.batches
    if not final and not early:
        return Judgement(None, "too early to tell")
    if settled_hz + _CLEAR * error_hz < limit_hz or (final and settled_hz < limit_hz):
        return Judgement(
            holds=False,
            reason=f"the backlog grows by {max(delivery.backlog_growth_hz, 0.0):.3g} messages/s",
        )
    if settled_hz - _CLEAR * error_hz > limit_hz or final:
        return Judgement(holds=True, reason="delivered as offered")
    return Judgement(None, "not clear yet")
