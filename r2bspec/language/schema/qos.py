"""Quality of service: a profile by name, or field by field."""

from __future__ import annotations

from r2bspec.language.qos_profiles import PROFILES
from r2bspec.language.schema.schema_builder import (
    Schema,
    choice,
    integer,
    loader_key,
    or_words,
    record,
)


def qos(description: str, *, default: object = None) -> Schema:
    """A quality-of-service profile."""
    fields = record(
        f"{description} The name of a ROS profile, or a map.",
        {
            "profile": loader_key(
                choice(
                    "The profile that provides the values of keys that this map does not set.",
                    list(PROFILES),
                    "default",
                )
            ),
            "reliability": choice(
                "Whether lost messages are sent again. A reliable subscription does not match a "
                "best-effort publisher.",
                ["reliable", "best_effort"],
                "reliable",
            ),
            "durability": choice(
                "Whether a subscription that is made later gets the last messages, too.",
                ["volatile", "transient_local"],
                "volatile",
            ),
            "history": choice(
                "Whether only the last 'depth' messages are kept, or all.",
                ["keep_last", "keep_all"],
                "keep_last",
            ),
            "depth": integer(
                "The number of messages that keep_last keeps.", minimum=1, default=10, examples=[10]
            ),
        },
        examples=[{"reliability": "best_effort", "depth": 5}],
        default=default,
        snippets=[
            {"label": "sensor data", "body": "sensor_data"},
            {
                "label": "field by field",
                "body": {"reliability": "best_effort", "depth": "${1:5}"},
            },
        ],
    )
    return or_words(fields, list(PROFILES), ["sensor_data"])
