"""The quality-of-service profiles of ROS, by their names in rclpy and rmw.

All fields are given explicitly, so that results do not depend on the defaults of a middleware.
`system_default`, which leaves every choice to the middleware, has the values that its publishers
use.
"""

from __future__ import annotations

from typing import Any


def _profile(
    depth: int, *, reliability: str = "reliable", durability: str = "volatile"
) -> dict[str, Any]:
    return {
        "reliability": reliability,
        "durability": durability,
        "history": "keep_last",
        "depth": depth,
    }


PROFILES: dict[str, dict[str, Any]] = {
    "default": _profile(10),
    "sensor_data": _profile(5, reliability="best_effort"),
    "services": _profile(10),
    "parameters": _profile(1000),
    "system_default": _profile(1),
    "clock": _profile(1, reliability="best_effort"),
    "rosout": _profile(1000, durability="transient_local"),
}
