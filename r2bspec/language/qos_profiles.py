"""ROS's quality-of-service profiles by the names that rclpy and rmw give them.

They are written out, so that a result does not depend on what a middleware takes for its default:
`system_default` leaves everything to it, and stands here for what its writers do.
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
