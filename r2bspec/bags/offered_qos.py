"""The quality of service that recorded publishers offered."""

from __future__ import annotations

from typing import Any, Final

import yaml

from r2bspec.language.quantities import Duration
from r2bspec.language.spec import QoS
from r2bspec.language.spec_graph import RMW_NUMBERS
from r2bspec.safe_io.safe_yaml import load_texts

_NO_LIMIT_S: Final = 2**31 - 1
"""Limits from here on are none, however a middleware writes that."""
_UNLESS_ALL: Final = {
    "reliability": ("reliable", "best_effort"),
    "durability": ("transient_local", "volatile"),
    "liveliness": ("manual_by_topic", "automatic"),
}
"""The stronger policy, and what is offered unless all publishers have it."""


def offered_profile(text: str) -> QoS | None:
    """Return the common QoS of all recorded publishers of a topic; None if unknown.

    If profiles differ, each field has the weaker value, as a subscription to all of them requests
    it. Discovery, from which a recorder has the profiles, does not tell the depth.

    Args:
        text: the profiles as metadata.yaml has them.
    """
    try:
        profiles: Any = load_texts(text) if text else None
        if not isinstance(profiles, list) or not profiles:
            return None
        read = [_profile(profile) for profile in profiles]
    except (yaml.YAMLError, ValueError, TypeError, KeyError, AttributeError):
        return None
    limits = {
        name: None
        if any(profile[name] is None for profile in read)
        else max(profile[name] for profile in read)
        for name in ("deadline", "lifespan", "lease_duration")
    }
    words = {
        name: stronger if all(profile[name] == stronger for profile in read) else weaker
        for name, (stronger, weaker) in _UNLESS_ALL.items()
    }
    return QoS.from_keys({**words, **limits})


def is_latched(text: str) -> bool:
    """Return True if all recorded publishers kept their last messages for later subscriptions."""
    offered = offered_profile(text)
    return offered is not None and offered.durability == "transient_local"


def _profile(written: dict[str, Any]) -> dict[str, Any]:
    words = {name: str(written[name]).lower() for name in _UNLESS_ALL}
    for name, word in words.items():
        # Before version 9 of metadata.yaml, policies are the numbers of rmw.
        numbers = {str(number): value for value, number in RMW_NUMBERS[name].items()}
        words[name] = numbers.get(word, word)
        if name == "reliability" and words[name] != "best_effort":
            # The default of a publisher, also where it is not known.
            words[name] = "reliable"
    return {
        **words,
        "deadline": _limit(written.get("deadline")),
        "lifespan": _limit(written.get("lifespan")),
        "lease_duration": _limit(written.get("liveliness_lease_duration")),
    }


def _limit(written: Any) -> Duration | None:
    seconds, nanoseconds = int(written["sec"]), int(written["nsec"])
    limit_ns = seconds * 10**9 + nanoseconds
    return None if seconds >= _NO_LIMIT_S or limit_ns <= 0 else Duration(limit_ns)
