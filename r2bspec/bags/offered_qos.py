"""The quality of service that recorded publishers offered."""

from __future__ import annotations

from typing import Any, Final

import yaml

from r2bspec.language.quantities import Duration
from r2bspec.language.spec import QoS
from r2bspec.safe_io.safe_yaml import load_texts

_NO_LIMIT_S: Final = 2**31 - 1
"""Limits from here on are none, however a middleware writes that."""
_WORDS: Final = {
    "reliability": {"1": "reliable", "2": "best_effort"},
    "durability": {"1": "transient_local", "2": "volatile"},
    "liveliness": {"1": "automatic", "3": "manual_by_topic"},
}
"""Before version 9 of metadata.yaml, policies are the numbers of rmw."""


def offered_profile(text: str) -> QoS | None:
    """Return what all recorded publishers of a topic offered; None if nothing is known of it.

    Of several profiles each field has the weaker value, as a subscription to all of them requests
    it. Discovery, from which a recorder has the profiles, tells no depth.

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
        name: None if any(each[name] is None for each in read) else max(each[name] for each in read)
        for name in ("deadline", "lifespan", "lease_duration")
    }
    words = {
        name: weaker if any(each[name] == weaker for each in read) else stronger
        for name, weaker, stronger in (
            ("reliability", "best_effort", "reliable"),
            ("durability", "volatile", "transient_local"),
            ("liveliness", "automatic", "manual_by_topic"),
        )
    }
    return QoS.from_keys({**words, **limits})


def _profile(written: dict[str, Any]) -> dict[str, Any]:
    words = {
        name: names.get(str(written[name]), str(written[name]).lower())
        for name, names in _WORDS.items()
    }
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
