"""Results that cannot be: what was measured then is not what happened, and is invalid.

    early      more than 1 % of the answers were received before their input was published
    surplus    by order, more than 1 % more outputs than the monitor's ratio allows

1 % is the share of messages that decides a p99 objective, and one message of another origin in a
hundred is no reason to discard a run. By order, an early output means that it answers another
input than the one it is matched to, and a surplus means that it is unknown which one it answers.
By stamp, it means that the times or the stamps are wrong.

Throughput cannot be more than offered times answered: see `r2bspec.measure.times`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from r2bspec.measure.metrics import pool_monitor
from r2bspec.measure.samples import MonitorSamples, SegmentSamples
from r2bspec.measure.units import show

MAX_IMPOSSIBLE_SHARE = 0.01


@dataclass(frozen=True)
class ImpossibleResult:
    """What is impossible, in one sentence, and what to do about it, in another."""

    reason: str
    remedy: str


def impossible_result(iterations: Sequence[SegmentSamples]) -> ImpossibleResult | None:
    """What is impossible in the iterations at a rate; None if nothing is.

    Args:
        iterations: all complete iterations at it, at least one.
    """
    if iterations[0].live:
        return None
    for name in iterations[0].monitors:
        seen = pool_monitor([one.monitors[name] for one in iterations])
        found = _surplus(name, seen) or _early(name, seen)
        if found is not None:
            return found
    return None


def _early(name: str, seen: MonitorSamples) -> ImpossibleResult | None:
    if seen.early <= MAX_IMPOSSIBLE_SHARE * seen.answered:
        return None
    counts = f"{show(seen.early, 'count')} of {show(seen.answered, 'count')} outputs"
    reason = (
        f"At monitor '{name}', {counts} were received before their input was published, which is "
        "impossible"
    )
    if seen.by_order:
        return ImpossibleResult(
            f"{reason}: matched by order, they answer other inputs.",
            "Match by stamp, or set the ratio of the monitor to what its node publishes.",
        )
    return ImpossibleResult(
        f"{reason}: their stamps or the times of their reception are wrong.",
        "Use outputs that keep the stamp of their input, or another middleware.",
    )


def _surplus(name: str, seen: MonitorSamples) -> ImpossibleResult | None:
    if seen.surplus <= MAX_IMPOSSIBLE_SHARE * seen.expected:
        return None
    received = show(seen.expected + seen.surplus, "count")
    return ImpossibleResult(
        f"Monitor '{name}' received {received} outputs for {show(seen.sent, 'count')} inputs, and "
        f"its ratio allows {show(seen.expected, 'count')}: which input each of them answers is "
        "unknown.",
        "Set the ratio of the monitor to what its node publishes, or match by stamp.",
    )
