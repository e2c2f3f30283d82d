"""How `init` plays the inputs of a recording.

One input leads: each of its messages makes a step. Inputs of the same rate whose stamps match those
of the leading input are in the steps, too. Other inputs are played between the steps, at their own
rate. A map is published once.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from typing import Any, Final

from r2bspec.bags.offered_qos import is_latched
from r2bspec.bags.recorded_times import TopicTimes
from r2bspec.bags.recording import TopicInfo
from r2bspec.language.quantities import Duration
from r2bspec.language.spec import QoS
from r2bspec.plan.nearest_stamps import LONGEST_DELAY_NS, clock_ahead, pair_nearest

_SAME_RATE: Final = 1.2
"""Inputs whose rates differ by at most this factor have the same rate."""
_SELDOM: Final = 10
"""A latched topic is published once if the input with most messages has so many times as many."""
_PAIRED: Final = 0.95
"""The least share of messages with a partner, for inputs that are played in the same steps."""
_MILLISECOND_NS: Final = 1_000_000


def lead_of(inputs: Mapping[str, TopicInfo], answered: Collection[str]) -> str:
    """Return the input that makes the steps; empty without inputs.

    If it is known which messages make a node publish, it is one of these inputs; otherwise the
    slowest input, because a node that joins inputs publishes once for each message of the slowest.
    """
    latched = latched_inputs(inputs)
    moving = [topic for topic in inputs if topic not in latched]
    candidates = [topic for topic in moving if topic in answered] or moving
    return min(candidates, key=lambda topic: inputs[topic].rate_hz or math.inf, default="")


def latched_inputs(inputs: Mapping[str, TopicInfo]) -> set[str]:
    """Return the inputs of which a single message is enough, such as maps; never all of them."""
    most = max((info.count for info in inputs.values()), default=0)
    latched = set()
    for topic, info in inputs.items():
        seldom = info.count == 1 or (
            is_latched(info.qos) and (info.count * _SELDOM < most or _is_first(info, inputs))
        )
        if seldom and info.count < most:
            latched.add(topic)
    return latched


def _is_first(info: TopicInfo, inputs: Mapping[str, TopicInfo]) -> bool:
    """Return True if all messages of a topic were recorded before those of the other inputs."""
    others = [other.first_ns for other in inputs.values() if other is not info]
    begin_ns = min((first_ns for first_ns in others if first_ns is not None), default=0)
    return info.last_ns is not None and info.last_ns < begin_ns


def input_keys(
    inputs: Mapping[str, TopicInfo], times: Mapping[str, TopicTimes], lead: str
) -> dict[str, dict[str, Any]]:
    """Return the keys `rate`, `pairing` and `clock_ahead` of each input that needs them.

    Args:
        inputs: the recorded topic of each input.
        times: the times of the inputs whose messages were read.
        lead: the input that makes the steps.
    """
    keys: dict[str, dict[str, Any]] = {topic: {} for topic in inputs}
    latched = latched_inputs(inputs)
    for topic, info in inputs.items():
        if topic in latched:
            keys[topic]["rate"] = "once"
        elif not _is_same_rate(info.rate_hz, inputs[lead].rate_hz):
            keys[topic]["rate"] = "recorded"
    stamped = [topic for topic, own in times.items() if own.stamps_ns and topic not in latched]
    right_ns = _right_stamps(keys, {topic: times[topic] for topic in stamped}, lead)
    for topic in stamped:
        if topic == lead or lead not in right_ns or "rate" in keys[topic]:
            continue
        slop_ns = _slop_ns(right_ns[lead], right_ns[topic]) if topic in right_ns else None
        if slop_ns is None:
            keys[topic]["rate"] = "recorded"
        elif slop_ns:
            keys[topic]["pairing"] = {"slop": str(Duration(slop_ns))}
    return keys


def _right_stamps(
    keys: dict[str, dict[str, Any]], times: Mapping[str, TopicTimes], lead: str
) -> dict[str, list[int]]:
    """Return the stamps of the inputs that are stamped like the lead, on one clock.

    The key `clock_ahead` is added to inputs whose clock differs. Messages with the same stamps, and
    others of which one was recorded later, are of one clock.
    """
    if lead not in times:
        return {}
    alike = {topic: own for topic, own in times.items() if own.is_stuck == times[lead].is_stuck}
    recorded_ns = [own.recorded_ns for own in alike.values()]
    ahead_ns = clock_ahead(recorded_ns, [own.stamps_ns for own in alike.values()], 0)
    by_ns = dict(zip(alike, ahead_ns, strict=True))
    for topic, own in alike.items():
        is_late = (
            abs(by_ns[topic] - by_ns[lead]) < LONGEST_DELAY_NS
            if "rate" in keys[topic]
            else _slop_ns(times[lead].stamps_ns, own.stamps_ns) == 0
        )
        if is_late:
            by_ns[topic] = by_ns[lead]
    least_ns = min(by_ns.values())
    right_ns = {}
    for topic, own in alike.items():
        wrong_ns = by_ns[topic] - least_ns
        right_ns[topic] = [stamp_ns - wrong_ns for stamp_ns in own.stamps_ns]
        if wrong_ns:
            keys[topic]["clock_ahead"] = str(Duration(wrong_ns))
    return right_ns


def _is_same_rate(rate_hz: float, lead_hz: float) -> bool:
    slower, faster = sorted((rate_hz, lead_hz))
    return faster <= _SAME_RATE * slower if slower > 0 else rate_hz == lead_hz


def _slop_ns(lead_ns: Sequence[int], other_ns: Sequence[int]) -> int | None:
    """Return by how much stamps of one step differ at most; None if they do not belong together."""
    gaps = [after - before for before, after in pairwise(lead_ns)]
    period_ns = round(statistics.median(gaps)) if gaps else 0
    for allowed_ns in (0, period_ns // 2):
        pairs = pair_nearest([lead_ns, other_ns], [allowed_ns, allowed_ns])
        if len(pairs) >= _PAIRED * max(len(lead_ns), len(other_ns)):
            differences = [abs(lead_ns[one] - other_ns[two]) for one, two in pairs]
            return math.ceil(max(differences) / _MILLISECOND_NS) * _MILLISECOND_NS
    return None


def input_qos(offered: QoS | None, requested: Collection[QoS]) -> dict[str, Any]:
    """Return the QoS fields of an input that differ from the default.

    They are what the recorded publishers offered, as far as the nodes of the graph accept that.
    """
    profile, default = offered or QoS(), QoS()
    changed: dict[str, Any] = {}
    for name, stronger in (
        ("reliability", "reliable"),
        ("durability", "transient_local"),
        ("liveliness", "manual_by_topic"),
    ):
        is_needed = any(getattr(other, name) == stronger for other in requested)
        word = stronger if is_needed else getattr(profile, name)
        if word != getattr(default, name):
            changed[name] = word
    for name in ("deadline", "lifespan", "lease_duration"):
        asked = [getattr(other, name) for other in requested] if name != "lifespan" else []
        limits = [limit.ns for limit in (getattr(profile, name), *asked) if limit is not None]
        if limits:
            changed[name] = str(Duration(min(limits)))
    return changed
